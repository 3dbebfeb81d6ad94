#include "agents/core/state_hash.h"

#include <gtest/gtest.h>

#include <cmath>
#include <initializer_list>

namespace lanewise {
namespace {

std::uint64_t HashOf(std::initializer_list<double> values) {
  StateHash hash;
  for (const double value : values) hash.Add(value);
  return hash.value();
}

TEST(StateHash, OrderMatters) {
  EXPECT_EQ(HashOf({1.0, 2.0, 3.0}), HashOf({1.0, 2.0, 3.0}));
  EXPECT_NE(HashOf({1.0, 2.0, 3.0}), HashOf({1.0, 3.0, 2.0}));
  EXPECT_NE(HashOf({0.0}), HashOf({0.0, 0.0}));
}

TEST(StateHash, OneBitMatters) {
  EXPECT_NE(HashOf({1.0}), HashOf({std::nextafter(1.0, 2.0)}));
  EXPECT_NE(HashOf({0.0}), HashOf({-0.0}));
  EXPECT_NE(HashOf({}), HashOf({0.0}));
}

}  // namespace
}  // namespace lanewise
