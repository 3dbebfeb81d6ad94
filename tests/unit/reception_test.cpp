#include "agents/v2x/reception.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace lanewise {
namespace {

TEST(Reception, BoundsDecideAsTheFormulasDo) {
  for (const bool loaded : {false, true}) {
    for (const double loss : {0.0, 0.2, 1.0}) {
      V2xParams params;
      params.loss = loss;
      const Reception reception(params, loaded);
      const double range2 = params.range * params.range;
      std::mt19937_64 random(7);
      std::uniform_real_distribution<double> share(0.0, 1.0);
      for (int k = 0; k < 20000; ++k) {
        // The ends of the range and of the load too.
        const double load = k % 10 == 0 ? 1.0 : (k % 10 == 1 || !loaded ? 0.0 : share(random));
        const double distance2 = k % 7 == 0 ? range2 : (k % 7 == 1 ? 0.0 : range2 * share(random));
        const Reception::Bounds* bounds = reception.AtLoad(load);
        const auto agrees = [&](std::uint32_t draw) {
          EXPECT_EQ(reception.FateOf(bounds, load, distance2, draw),
                    reception.ExactFateOf(load, distance2, draw))
              << "load " << load << " distance^2 " << distance2 << " draw " << draw;
        };
        const auto draw = static_cast<std::uint32_t>(random());
        agrees(draw);
        agrees(0);
        agrees(0xffffffffu);
        if (k % 50 != 0) continue;
        // The last draw that is delivered, and those about it.
        std::uint64_t low = 0, high = 0x100000000ULL;
        while (low < high) {
          const std::uint64_t middle = (low + high) / 2;
          const Fate fate = reception.ExactFateOf(load, distance2, static_cast<std::uint32_t>(middle));
          (fate == Fate::kDelivered ? low : high) = middle + (fate == Fate::kDelivered ? 1 : 0);
        }
        for (std::uint64_t near = low < 3 ? 0 : low - 3;
             near < std::min<std::uint64_t>(low + 3, 0x100000000ULL); ++near)
          agrees(static_cast<std::uint32_t>(near));
      }
    }
  }
}

TEST(Reception, LatencyIsThatOfTheFormula) {
  V2xParams params;
  for (const double mean : {0.005, 0.02, 0.15}) {
    for (const double dt : {0.1, 0.05, 1.0}) {
      params.latency_mean = mean;
      Reception reception(params, false);
      reception.SetStep(dt);
      std::mt19937 random(3);
      for (int k = 0; k < 20000; ++k) {
        const std::uint32_t draw =
            k < 100 ? static_cast<std::uint32_t>(k) : static_cast<std::uint32_t>(random() >> (k % 20));
        const std::int32_t latency = reception.ExactLatency(dt, draw);
        ASSERT_EQ(reception.Latency(draw), latency) << "draw " << draw;
        ASSERT_EQ(reception.IsThereNextStep(draw), latency == 1) << "draw " << draw;
      }
    }
  }
  params.latency_min = params.latency_mean = params.latency_max = 0.0;
  Reception reception(params, false);
  reception.SetStep(0.1);
  EXPECT_EQ(reception.Latency(5), 0);
  EXPECT_FALSE(reception.IsThereNextStep(5));
}

}  // namespace
}  // namespace lanewise
