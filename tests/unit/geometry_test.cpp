#include "agents/core/geometry.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <random>
#include <vector>

#include "analysis/conflict_geometry.h"

namespace lanewise {
namespace {

constexpr double kPi = std::numbers::pi;

/// A car 4 m long and 2 m wide with its front bumper at (x, y).
Footprint Car(double x, double y, double heading = 0.0) {
  return {{x, y, heading}, 4.0, 2.0};
}

std::optional<double> TimeToContact(const Footprint& a, Point2 velocity_a, const Footprint& b,
                                    Point2 velocity_b, double horizon) {
  return lanewise::TimeToContact(BoxOf(a, velocity_a), BoxOf(b, velocity_b), horizon);
}

TEST(WrapAngle, IsPeriodicAndKeepsTheEnds) {
  EXPECT_NEAR(WrapAngle(3.0 * kPi / 2.0), -kPi / 2.0, 1e-12);
  EXPECT_NEAR(WrapAngle(-5.0 * kPi / 2.0), -kPi / 2.0, 1e-12);
  EXPECT_EQ(WrapAngle(kPi), kPi);
  EXPECT_EQ(WrapAngle(-kPi), -kPi);
  EXPECT_EQ(WrapAngle(0.3), 0.3);
}

TEST(PointOn, GoesByLengthOverEveryPiece) {
  const std::vector<Point2> line{{0.0, 0.0}, {6.0, 0.0}, {6.0, 0.0}, {6.0, 4.0}};
  EXPECT_NEAR(PointOn(line, 0.0).x, 0.0, 1e-12);
  EXPECT_NEAR(PointOn(line, 0.3).x, 3.0, 1e-12);
  EXPECT_NEAR(PointOn(line, 0.8).x, 6.0, 1e-12);
  EXPECT_NEAR(PointOn(line, 0.8).y, 2.0, 1e-12);
  EXPECT_NEAR(PointOn(line, 1.0).y, 4.0, 1e-12);
  EXPECT_NEAR(PointOn(std::vector<Point2>{{1.0, 2.0}}, 0.5).y, 2.0, 1e-12);
}

TEST(Distance, InOneLaneIsTheGap) {
  EXPECT_NEAR(Distance(Car(10.0, 0.0), Car(0.0, 0.0)), 6.0, 1e-12);
}

TEST(Distance, OfOffsetBoxesIsBetweenCorners) {
  // Gaps of 3 m along and 4 m across: corner to corner.
  EXPECT_NEAR(Distance(Car(7.0, 6.0), Car(0.0, 0.0)), 5.0, 1e-12);
}

TEST(Distance, OfATurnedBoxIsCornerToEdge) {
  // b points at the flank of a (y = 1) from above with a corner: half diagonal of 4 x 2 turned to vertical.
  const double heading = -kPi / 2.0 - std::atan2(1.0, 2.0);
  Footprint b = Car(0.0, 0.0, heading);
  b.front.x = -2.0 + 2.0 * std::cos(heading);
  b.front.y = 10.0 + 2.0 * std::sin(heading);  // Center at (-2, 10).
  EXPECT_NEAR(Distance(Car(0.0, 0.0), b), 9.0 - std::sqrt(5.0), 1e-12);
}

TEST(Distance, IsZeroWhenBoxesOverlapAndWhenTheyTouch) {
  EXPECT_EQ(Distance(Car(3.0, 0.5), Car(0.0, 0.0)), 0.0);
  EXPECT_EQ(Distance(Car(4.0, 0.0), Car(0.0, 0.0)), 0.0);
}

TEST(PenetrationDepth, IsTheSmallestSeparatingShift) {
  EXPECT_NEAR(PenetrationDepth(Car(3.5, 0.0), Car(0.0, 0.0)), 0.5, 1e-12);  // Lengthwise.
  EXPECT_NEAR(PenetrationDepth(Car(0.0, 1.7), Car(0.0, 0.0)), 0.3, 1e-12);  // Sideways.
  // A crossing car whose front is 0.4 m into the flank.
  EXPECT_NEAR(PenetrationDepth(Car(-2.0, -0.6, kPi / 2.0), Car(0.0, 0.0)), 0.4, 1e-12);
}

TEST(PenetrationDepth, IsMinusTheGapWhenSeparated) {
  EXPECT_NEAR(PenetrationDepth(Car(10.0, 0.0), Car(0.0, 0.0)), -6.0, 1e-12);
}

TEST(TimeToContact, OfFollowingIsGapOverClosingSpeed) {
  const auto ttc = TimeToContact(Car(0.0, 0.0), {15.0, 0.0}, Car(14.0, 0.0), {10.0, 0.0}, 10.0);
  ASSERT_TRUE(ttc);
  EXPECT_NEAR(*ttc, 2.0, 1e-12);
}

TEST(TimeToContact, OfCrossingIsTheLaterOfBothEntries) {
  // a needs 2.0 s to the flank of the other's path (x = 19 at 9.5 m/s); b covers that place from 1.9 to 2.5
  // s.
  const Footprint a = Car(0.0, 0.0);
  const Footprint b = Car(20.0, -20.0, kPi / 2.0);
  const auto ttc = TimeToContact(a, {9.5, 0.0}, b, {0.0, 10.0}, 10.0);
  ASSERT_TRUE(ttc);
  EXPECT_NEAR(*ttc, 2.0, 1e-12);
}

TEST(TimeToContact, IsNothingWhenTheyPass) {
  const Footprint b = Car(20.0, -20.0, kPi / 2.0);
  EXPECT_FALSE(TimeToContact(Car(0.0, 0.0), {3.0, 0.0}, b, {0.0, 10.0}, 100.0));  // b has gone.
  EXPECT_FALSE(
      TimeToContact(Car(0.0, 3.0), {15.0, 0.0}, Car(30.0, 0.0), {-15.0, 0.0}, 100.0));         // Other lane.
  EXPECT_FALSE(TimeToContact(Car(0.0, 0.0), {5.0, 0.0}, Car(14.0, 0.0), {10.0, 0.0}, 100.0));  // Opening.
  EXPECT_FALSE(TimeToContact(Car(0.0, 0.0), {5.0, 0.0}, Car(14.0, 0.0), {5.0, 0.0}, 100.0));   // Constant.
}

TEST(TimeToContact, EndsAtTheHorizon) {
  EXPECT_FALSE(TimeToContact(Car(0.0, 0.0), {15.0, 0.0}, Car(14.0, 0.0), {10.0, 0.0}, 1.9));
  EXPECT_TRUE(TimeToContact(Car(0.0, 0.0), {15.0, 0.0}, Car(14.0, 0.0), {10.0, 0.0}, 2.1));
}

TEST(TimeToContact, IsZeroForOverlap) {
  const auto ttc = TimeToContact(Car(0.0, 0.0), {1.0, 0.0}, Car(3.0, 0.5), {5.0, 0.0}, 3.0);
  ASSERT_TRUE(ttc);
  EXPECT_EQ(*ttc, 0.0);
}

TEST(Geometry, MeasuresAgreeOnRandomPairs) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> place(-12.0, 12.0), angle(-kPi, kPi), size(0.5, 8.0),
      speed(-10.0, 10.0);
  int contacts = 0;
  for (int k = 0; k < 20000; ++k) {
    Footprint a{{place(random), place(random), angle(random)}, size(random), size(random)};
    Footprint b{{place(random), place(random), angle(random)}, size(random), size(random)};
    const Point2 va{speed(random), speed(random)}, vb{speed(random), speed(random)};
    const double depth = PenetrationDepth(a, b), distance = Distance(a, b);
    EXPECT_NEAR(depth, PenetrationDepth(b, a), 1e-9);
    EXPECT_NEAR(distance, Distance(b, a), 1e-9);
    EXPECT_EQ(distance > 0.0, depth < 0.0);
    EXPECT_LE(std::max(0.0, -depth), distance + 1e-9);
    const auto ttc = TimeToContact(a, va, b, vb, 3.0);
    if (ttc && *ttc > 0.0) {  // Just before they are apart, at that time they touch.
      ++contacts;
      const auto at = [&](double t) {
        Footprint a_t = a, b_t = b;
        a_t.front.x += va.x * t, a_t.front.y += va.y * t;
        b_t.front.x += vb.x * t, b_t.front.y += vb.y * t;
        return PenetrationDepth(a_t, b_t);
      };
      EXPECT_NEAR(at(*ttc), 0.0, 1e-9);
      EXPECT_LT(at(0.999 * *ttc), 0.0);
    } else if (!ttc) {
      EXPECT_GT(distance, 0.0);
    }
  }
  EXPECT_GT(contacts, 1000);
}

}  // namespace
}  // namespace lanewise
