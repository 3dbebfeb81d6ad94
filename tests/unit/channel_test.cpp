#include "agents/v2x/channel.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>

#include "agents/core/check.h"
#include "agents/core/geometry.h"
#include "agents/v2x/radio.h"
#include "tests/support/no_alloc.h"
#include "tests/support/small_nets.h"

namespace lanewise {
namespace {

constexpr double kDt = 0.1;  // [s]

/// Vehicles put where a test wants them, on the one lane of a network.
class Cars {
 public:
  explicit Cars(std::size_t count) : network(ChainNet(1, 1, 1000.0)) {
    traffic.vehicle_count = count;
    traffic.Resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      traffic.number[i] = static_cast<std::int32_t>(i);
      traffic.id_hash[i] = HashText(fmt::format("car{}", i));
      traffic.now.lane[i] = 0;
      traffic.now.follows[i] = kNone;
      traffic.plan[i] = nullptr;
    }
  }

  void Scatter(double extent, std::uint64_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> place(0.0, extent), speed(0.0, 20.0);
    for (std::size_t i = 0; i < traffic.vehicle_count; ++i) {
      traffic.now.x[i] = place(random);
      traffic.now.y[i] = place(random);
      traffic.now.speed[i] = speed(random);
    }
  }
  /// Everybody drives on for a step, eastward.
  void Move() {
    for (std::size_t i = 0; i < traffic.vehicle_count; ++i) traffic.now.x[i] += kDt * traffic.now.speed[i];
  }

  RoadNetwork network;
  Traffic traffic;
};

V2xParams EveryStep() {
  V2xParams params;
  params.cam_max_interval = params.cam_min_interval;
  return params;
}

TEST(Channel, ClosedNobodyHearsAnything) {
  Cars cars(2);
  Channel channel(cars.network, {});
  channel.Exchange(kDt, cars.traffic);
  EXPECT_FALSE(channel.LastFrom(0, 1));
  EXPECT_EQ(channel.counts().sent, 0);
}

TEST(Channel, IdealHearsAcrossTheMapAtOnce) {
  Cars cars(3);
  cars.traffic.now.x[1] = 1e6;
  cars.traffic.now.speed[1] = 12.5;
  Channel channel(cars.network, EveryStep());
  channel.Open(V2xLevel::kIdeal, 1);
  channel.Exchange(kDt, cars.traffic);
  const auto heard = channel.LastFrom(0, 1);
  ASSERT_TRUE(heard);
  EXPECT_EQ(heard->age, 0.0);
  EXPECT_EQ(heard->message->x, 1e6);
  EXPECT_FLOAT_EQ(heard->message->speed, 12.5f);
  EXPECT_FALSE(channel.LastFrom(0, 0)) << "its own";
  int known = 0;
  channel.ForEachKnown(2, [&](const Received&) { ++known; });
  EXPECT_EQ(known, 2);
  EXPECT_EQ(channel.counts().sent, 3);
  EXPECT_EQ(channel.counts().fates[0], 6);
}

TEST(Channel, RangeEndsWhereItSays) {
  Cars cars(3);
  cars.traffic.now.x[1] = 300.0;
  cars.traffic.now.x[2] = -300.1;
  Channel channel(cars.network, EveryStep());
  channel.Open(V2xLevel::kRange, 1);
  channel.Exchange(kDt, cars.traffic);
  EXPECT_TRUE(channel.LastFrom(0, 1));
  EXPECT_FALSE(channel.LastFrom(0, 2));
  // What was heard is remembered for v2x.memory, and forgotten then.
  cars.traffic.now.x[1] = 1000.0;
  for (int k = 1; k <= 20; ++k) channel.Exchange(kDt, cars.traffic);
  ASSERT_TRUE(channel.LastFrom(0, 1));
  EXPECT_NEAR(channel.LastFrom(0, 1)->age, 2.0, 1e-9);
  EXPECT_EQ(channel.LastFrom(0, 1)->message->x, 300.0);
  channel.Exchange(kDt, cars.traffic);
  EXPECT_FALSE(channel.LastFrom(0, 1));
}

/// What the channel's documentation says, for all pairs and in the plainest way.
struct Reference {
  const V2xParams& params;
  V2xLevel level;
  std::uint64_t seed;
  std::array<std::int64_t, kFates> fates{};
  // By receiver and sender: step of generation of the last message known; and what is on its way.
  std::vector<std::vector<std::int32_t>> last{};
  struct Flight {
    std::size_t receiver, sender;
    std::int32_t sent, due;
  };
  std::vector<Flight> flying{};

  void Step(std::int32_t step, const Traffic& traffic) {
    const std::size_t n = traffic.vehicle_count;
    last.resize(n, std::vector<std::int32_t>(n, -1));
    std::erase_if(flying, [&](const Flight& f) {
      if (f.due > step) return false;
      last[f.receiver][f.sender] = std::max(last[f.receiver][f.sender], f.sent);
      return true;
    });
    for (std::size_t r = 0; r < n; ++r) {
      double load = 0.0;
      for (std::size_t s = 0; s < n; ++s) {
        if (Distance(traffic, r, s) <= params.carrier_sense_range)
          load += Airtime(params.message_bytes, params.bitrate) / kDt;
      }
      load = std::min(1.0, load);
      for (std::size_t s = 0; s < n; ++s) {
        const double distance = Distance(traffic, r, s);
        if (s == r || distance > params.range) continue;
        const RandomStream draws(seed, traffic.id_hash[s], RandomPurpose::kRadioDelivery,
                                 static_cast<std::uint64_t>(step));
        const std::uint64_t bits = draws.Bits(traffic.id_hash[r]);
        const double u = static_cast<double>(bits >> 32) / 4294967296.0;
        const double passes_loss = 1.0 - params.loss;
        const double passes_fading =
            passes_loss * FadingReception(distance * distance / (params.fading_range * params.fading_range));
        const double passes_load =
            passes_fading * CollisionFree(load, HiddenShare(distance, params.carrier_sense_range));
        const bool lossy = level >= V2xLevel::kLossy, loaded = level == V2xLevel::kLoaded;
        const Fate fate = lossy && u >= passes_loss     ? Fate::kDropped
                          : lossy && u >= passes_fading ? Fate::kFaded
                          : loaded && u >= passes_load  ? Fate::kCollided
                                                        : Fate::kDelivered;
        ++fates[static_cast<std::size_t>(fate)];
        if (fate != Fate::kDelivered) continue;
        const double v = (static_cast<double>(bits & 0xffffffffu) + 0.5) / 4294967296.0;
        const double latency =
            std::min(params.latency_max,
                     params.latency_min - (params.latency_mean - params.latency_min) * std::log(v));
        if (lossy) {
          flying.push_back({r, s, step, step + static_cast<std::int32_t>(std::ceil(latency / kDt - 1e-9))});
        } else {
          last[r][s] = step;
        }
      }
    }
  }

  static double Distance(const Traffic& traffic, std::size_t a, std::size_t b) {
    return std::sqrt(std::pow(traffic.now.x[a] - traffic.now.x[b], 2) +
                     std::pow(traffic.now.y[a] - traffic.now.y[b], 2));
  }
};

class ChannelLevels : public testing::TestWithParam<V2xLevel> {};

TEST_P(ChannelLevels, AgreesWithAllPairs) {
  Cars cars(300);
  cars.Scatter(1200.0, 5);
  V2xParams params = EveryStep();
  params.loss = 0.1;
  params.latency_mean = 0.12;  // Some messages overtake others.
  Channel channel(cars.network, params);
  channel.Open(GetParam(), 42);
  Reference reference{params, GetParam(), 42};
  for (std::int32_t step = 0; step < 12; ++step) {
    channel.Exchange(kDt, cars.traffic);
    reference.Step(step, cars.traffic);
    for (StationId r = 0; r < 300; ++r) {
      for (StationId s = 0; s < 300; ++s) {
        const auto heard = channel.LastFrom(r, s);
        const std::int32_t expected =
            reference.last[static_cast<std::size_t>(r)][static_cast<std::size_t>(s)];
        ASSERT_EQ(heard ? heard->message->step : -1, expected) << "step " << step << ": " << s << " to " << r;
        if (heard) {
          ASSERT_EQ(heard->message->sender, s);
        }
      }
    }
    cars.Move();
  }
  EXPECT_EQ(channel.counts().fates, reference.fates);
  EXPECT_EQ(channel.counts().sent, 300 * 12);
  EXPECT_GT(channel.counts().fates[0], 0);
  if (GetParam() == V2xLevel::kLoaded) {
    for (const std::int64_t count : reference.fates) EXPECT_GT(count, 0);
    EXPECT_GT(channel.counts().step_busy_max, 0.1);
  }
}

INSTANTIATE_TEST_SUITE_P(Channel, ChannelLevels,
                         testing::Values(V2xLevel::kRange, V2xLevel::kLossy, V2xLevel::kLoaded),
                         [](const auto& info) {
                           return std::string(kV2xLevelNames[static_cast<std::size_t>(info.param)]);
                         });

TEST(Channel, DoesNotDependOnThreads) {
  const auto run = [](int threads) {
    omp_set_num_threads(threads);
    Cars cars(400);
    cars.Scatter(1000.0, 3);
    Channel channel(cars.network, {});
    channel.Open(V2xLevel::kLoaded, 9);
    for (int k = 0; k < 20; ++k) {
      channel.Exchange(kDt, cars.traffic);
      cars.Move();
    }
    return channel.counts();
  };
  const ChannelCounts one = run(1), four = run(4);
  EXPECT_EQ(one.sent, four.sent);
  EXPECT_EQ(one.fates, four.fates);
  EXPECT_EQ(one.age_steps, four.age_steps);
  EXPECT_EQ(one.age_histogram, four.age_histogram);
  EXPECT_EQ(one.busy_sum, four.busy_sum);
}

TEST(Channel, DoesNotAllocateOnceWarm) {
  omp_set_num_threads(1);
  Cars cars(300);
  cars.Scatter(900.0, 3);
  Channel channel(cars.network, {});
  channel.Open(V2xLevel::kLoaded, 9);
  int steps = 0;
  const auto step = [&] {  // To and fro, so that neighbors change but do not become more.
    channel.Exchange(kDt, cars.traffic);
    cars.Move();
    if (++steps % 25 != 0) return;
    for (double& speed : cars.traffic.now.speed) speed = -speed;
  };
  for (int k = 0; k < 200; ++k) step();
  const AllocationCounter allocations;
  for (int k = 0; k < 100; ++k) step();
  EXPECT_EQ(allocations.count(), 0);
}

TEST(Channel, AHigherShareContainsALowerOne) {
  Cars cars(1000);
  V2xParams params;
  params.share = 0.3;
  Channel low(cars.network, params);
  params.share = 0.6;
  Channel high(cars.network, params);
  for (Channel* channel : {&low, &high}) {
    channel->Open(V2xLevel::kIdeal, 5);
    channel->Exchange(kDt, cars.traffic);
  }
  int of_low = 0, of_high = 0;
  for (StationId i = 0; i < 1000; ++i) {
    of_low += low.IsEquipped(i);
    of_high += high.IsEquipped(i);
    EXPECT_LE(low.IsEquipped(i), high.IsEquipped(i));
  }
  EXPECT_NEAR(of_low, 300, 60);
  EXPECT_NEAR(of_high, 600, 60);
  EXPECT_EQ(low.counts().sent, of_low);
  // Who has no radio hears nothing, and is not heard.
  for (StationId i = 0; i < 1000; ++i) {
    if (low.IsEquipped(i)) continue;
    EXPECT_FALSE(low.LastFrom(i, 0));
    EXPECT_FALSE(low.LastFrom(0, i));
  }
}

TEST(Channel, MoreLossTakesMessagesAndGivesNone) {
  const auto delivered = [](double loss) {
    Cars cars(100);
    cars.Scatter(300.0, 8);
    V2xParams params = EveryStep();
    params.loss = loss;
    Channel channel(cars.network, params);
    channel.Open(V2xLevel::kLossy, 2);
    channel.Exchange(kDt, cars.traffic);
    channel.Exchange(kDt, cars.traffic);
    std::vector<bool> heard;
    for (StationId r = 0; r < 100; ++r) {
      for (StationId s = 0; s < 100; ++s) heard.push_back(channel.LastFrom(r, s).has_value());
    }
    return heard;
  };
  const std::vector<bool> none = delivered(0.0), half = delivered(0.5), all = delivered(1.0);
  for (std::size_t k = 0; k < none.size(); ++k) EXPECT_LE(half[k], none[k]);
  EXPECT_LT(std::count(half.begin(), half.end(), true), std::count(none.begin(), none.end(), true));
  EXPECT_EQ(std::count(all.begin(), all.end(), true), 0);
}

/// Steps in which car 0 sends.
std::vector<int> SendSteps(Cars* cars, int steps, const std::function<void(int)>& drive) {
  Channel channel(cars->network, {});
  channel.Open(V2xLevel::kIdeal, 1);
  std::vector<int> sent;
  for (int k = 0; k < steps; ++k) {
    drive(k);
    channel.Exchange(kDt, cars->traffic);
    const auto heard = channel.LastFrom(1, 0);
    if (heard && heard->age == 0.0) sent.push_back(k);
  }
  return sent;
}

TEST(Channel, CamsFollowTheTriggerRules) {
  using Steps = std::vector<int>;
  Cars cars(2);
  Motion& now = cars.traffic.now;
  // Nothing changes: once a second.
  EXPECT_EQ(SendSteps(&cars, 31, [](int) {}), Steps({0, 10, 20, 30}));
  // 13 m/s: more than 4 m after four steps of 1.3 m.
  now.speed[0] = 13.0;
  EXPECT_EQ(SendSteps(&cars, 13, [&](int) { now.x[0] += 1.3; }), Steps({0, 4, 8, 12}));
  // Exactly 4 m are not more than 4 m.
  EXPECT_EQ(SendSteps(&cars, 8, [&](int k) { now.x[0] = 1.0 * k; }), Steps({0, 5}));
  // Speed: 0.3 m/s a step. Heading: 0.05 rad a step, over the wrap at pi.
  now.x[0] = 0.0;
  EXPECT_EQ(SendSteps(&cars, 6, [&](int k) { now.speed[0] = 10.0 + 0.3 * k; }), Steps({0, 2, 4}));
  EXPECT_EQ(SendSteps(&cars, 6, [&](int k) { now.heading[0] = WrapAngle(3.1 + 0.05 * k); }),
            Steps({0, 2, 4}));
  // One change after 0.3 s, then none: three CAMs more at that interval (N_GenCam), then one a second.
  EXPECT_EQ(SendSteps(&cars, 33, [&](int k) { now.speed[0] = k < 3 ? 10.0 : 11.0; }),
            Steps({0, 3, 6, 9, 12, 22, 32}));
}

TEST(Channel, RoadsideUnitsSendAndHear) {
  Cars cars(2);
  cars.traffic.now.x[1] = 5000.0;
  Channel channel(cars.network, EveryStep());
  const StationId unit = channel.AddRoadsideUnit(50.0, 0.0, "J1");
  channel.Open(V2xLevel::kRange, 1);
  channel.Post(unit, 77, 200.0);
  channel.Exchange(kDt, cars.traffic);
  ASSERT_TRUE(channel.LastFrom(0, unit));
  EXPECT_EQ(channel.LastFrom(0, unit)->message->payload, 77u);
  EXPECT_EQ(channel.LastFrom(0, unit)->message->sender, unit);
  EXPECT_TRUE(channel.LastFrom(unit, 0));
  EXPECT_FALSE(channel.LastFrom(1, unit));
  EXPECT_FALSE(channel.LastFrom(unit, 1));
  // It sends what is posted, no more.
  channel.Exchange(kDt, cars.traffic);
  EXPECT_NEAR(channel.LastFrom(0, unit)->age, kDt, 1e-12);
}

TEST(Channel, ForgetsWhoHasLeft) {
  Cars cars(3);
  Channel channel(cars.network, EveryStep());
  channel.Open(V2xLevel::kRange, 1);
  channel.Exchange(kDt, cars.traffic);
  ASSERT_TRUE(channel.LastFrom(0, 2));
  cars.traffic.RemoveRow(0);  // Car 2 moves to row 0.
  cars.traffic.vehicle_count = 2;
  channel.Exchange(kDt, cars.traffic);
  EXPECT_FALSE(channel.LastFrom(0, 2)) << "it is gone";
  EXPECT_TRUE(channel.LastFrom(2, 1));
  EXPECT_TRUE(channel.LastFrom(1, 0)) << "still remembered";
  EXPECT_NEAR(channel.LastFrom(1, 0)->age, kDt, 1e-12);
}

TEST(Channel, WhoIsOffTheRoadTakesWhatWasDueWhenItIsBack) {
  Cars cars(2);
  V2xParams params = EveryStep();
  params.fading_range = 5000.0;
  Channel channel(cars.network, params);
  channel.Open(V2xLevel::kLossy, 1);
  channel.Exchange(kDt, cars.traffic);
  EXPECT_FALSE(channel.LastFrom(0, 1)) << "on its way";
  cars.traffic.now.lane[0] = kNone;
  for (int k = 0; k < 3; ++k) channel.Exchange(kDt, cars.traffic);
  EXPECT_FALSE(channel.LastFrom(0, 1));
  cars.traffic.now.lane[0] = 0;
  channel.Exchange(kDt, cars.traffic);
  ASSERT_TRUE(channel.LastFrom(0, 1));
  EXPECT_EQ(channel.LastFrom(0, 1)->message->step, 0);
}

TEST(Channel, AgesAreCountedBetweenMessages) {
  Cars cars(2);
  Channel channel(cars.network, {});  // Both stand: a message a second.
  channel.Open(V2xLevel::kRange, 1);
  for (int k = 0; k <= 20; ++k) channel.Exchange(kDt, cars.traffic);
  // Two pairs, two intervals of 10 steps: ages 0 to 9.
  EXPECT_EQ(channel.counts().age_count, 40);
  EXPECT_EQ(channel.counts().age_steps, 4 * 45);
  for (std::size_t age = 0; age < 10; ++age) EXPECT_EQ(channel.counts().age_histogram[age], 4);
  EXPECT_EQ(channel.counts().age_histogram[10], 0);
}

TEST(Channel, PositionsAreNoisyFromLossyOn) {
  Cars cars(200);
  V2xParams params = EveryStep();
  params.position_noise = 2.0;
  params.latency_min = params.latency_mean = params.latency_max = 0.0;
  params.fading_range = 5000.0;
  double square = 0.0;
  for (const V2xLevel level : {V2xLevel::kRange, V2xLevel::kLossy}) {
    Channel channel(cars.network, params);
    channel.Open(level, 1);
    channel.Exchange(kDt, cars.traffic);
    square = 0.0;
    for (StationId s = 1; s < 200; ++s) square += std::pow(channel.LastFrom(0, s)->message->x, 2) / 199.0;
    if (level == V2xLevel::kRange) {
      EXPECT_EQ(square, 0.0);
    }
  }
  EXPECT_NEAR(std::sqrt(square), 2.0, 0.3);
}

TEST(Channel, RefusesImpossibleParameters) {
  const auto refuses = [](auto&& change, const char* name) {
    V2xParams params;
    change(&params);
    try {
      CheckV2xParams(params);
      ADD_FAILURE() << name << " was accepted";
    } catch (const ConfigError& error) {
      EXPECT_NE(std::string(error.what()).find(name), std::string::npos) << error.what();
    }
  };
  EXPECT_NO_THROW(CheckV2xParams({}));
  refuses([](V2xParams* p) { p->latency_min = 0.5; }, "v2x.latency_min");
  refuses([](V2xParams* p) { p->latency_mean = 0.5; }, "v2x.latency_mean");
  refuses([](V2xParams* p) { p->latency_max = 5.0; }, "v2x.latency_max");
  refuses([](V2xParams* p) { p->cam_min_interval = 2.0; }, "v2x.cam_min_interval");
  refuses([](V2xParams* p) { p->range = 500.0; }, "v2x.range");
  EXPECT_THROW(ParseV2xLevel("perfect", "--v2x"), ConfigError);
}

}  // namespace
}  // namespace lanewise
