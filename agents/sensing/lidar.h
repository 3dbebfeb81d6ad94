#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "agents/agent_params.h"
#include "agents/core/random.h"
#include "agents/core/types.h"

namespace lanewise {

/// The sensor of [A], a UTM-30LX: 270 deg, one beam each 0.25 deg, 1,081 ranges, 30 m, 25 ms a scan.
LidarParams SongLidar();
/// The simulated lidar of [C]: 360 rays all around.
LidarParams RingLidar();

/// Sectors of the code of [A]: the front 180 deg in eight parts of 22.5 deg, number 0 at the left.
inline constexpr int kSectors = 8;

/// A reflecting edge in the frame of the sensor (x forward, y left) [m]; seen from the sensor b lies
/// counter-clockwise of a.
struct ReflectingEdge {
  Point2 a, b;
};

/// A box of a road user or thing, in the frame of the sensor.
struct ReflectingBox {
  Point2 center;
  Point2 axis;  ///< Unit vector along its length.
  double half_length, half_width;
};

/// What may reflect a beam. Reused from scan to scan: after warm-up nothing is allocated.
class LidarScene {
 public:
  void Clear() { edges_.clear(); }
  void Reserve(std::size_t edges) { edges_.reserve(edges); }
  /// The sides that face the sensor; all four if the sensor is inside.
  void AddBox(const ReflectingBox& box);
  /// An edge that reflects on both sides. One seen end on reflects nothing.
  void AddEdge(Point2 a, Point2 b);
  std::span<const ReflectingEdge> edges() const { return edges_; }

 private:
  std::vector<ReflectingEdge> edges_;
};

/// Errors of one scan, a function of (seed, vehicle, step): each range is off by a normal error cut off at
/// four deviations, each beam drops out with a probability (in steps of 1/256).
class ScanErrors {
 public:
  ScanErrors(const LidarParams& params, std::uint64_t seed, std::int32_t vehicle, std::int64_t step);
  /// No errors.
  ScanErrors();

  double RangeError(int beam) const;                 ///< [m]
  double max_range_error() const { return bound_; }  ///< [m]
  std::uint64_t DroppedWord(int word) const;         ///< Bit i: beam 64 * word + i is dropped.
  bool Dropped(int beam) const { return DroppedWord(beam / 64) >> (beam % 64) & 1; }
  bool drops() const { return dropout_ > 0; }

 private:
  double deviation_, bound_;
  unsigned dropout_;  // Of 256.
  RandomStream range_, drop_;
};

/// Where a reading counts as an obstacle [m]: from `near` on; in the two front sectors as far as `far`,
/// within `half_width` to the sides, the strip the vehicle is about to drive; in the others as far as `side`,
/// within `side_width`. Star-shaped about the sensor.
struct AvoidanceZone {
  double near, far, half_width, side;
  double side_width{std::numeric_limits<double>::infinity()};
};

/// The zone for a speed: far = standstill + v (reaction time + scan period) + v^2 / (2 b), less what a leader
/// of this speed needs to stop; at most the lidar's range. [A] has one ring, 0.4 to 0.6 m, for a robot that
/// turns on the spot: a ring as far as a car's braking distance would see its own road's borders in every
/// sector.
/// @param width of the vehicle [m].
AvoidanceZone ZoneForSpeed(const AgentParams& params, double width, double speed, double leader_speed = 0.0);

/// The zone in which a vehicle on an open road sees to which side it may turn: as above, but ahead at least
/// sector.turn_reach, and beside it a strip of sector.turn_width to each side, as far ahead: a ring would see
/// the borders of the road before it sees which end of a wall is open.
AvoidanceZone TurnZone(const AgentParams& params, double width, double speed);

/// The zone with less reach.
AvoidanceZone DrawnIn(const AvoidanceZone& zone, double factor);

using SectorCounts = std::array<std::int32_t, kSectors>;

/// Eq. 8 of [A]: bit i is 1 (free) unless more than `min_points` readings of sector i lie in the zone.
std::uint8_t SectorCode(const SectorCounts& counts, int min_points);

/// The beams of a lidar, tabled.
class Lidar {
 public:
  explicit Lidar(const LidarParams& params);

  int beams() const { return static_cast<int>(x_.size()); }
  double Angle(int beam) const { return first_angle_ + beam * spacing_; }  ///< [rad], left positive.
  double spacing() const { return spacing_; }                              ///< [rad] from beam to beam.
  const LidarParams& params() const { return params_; }

  /// Casts every beam. @param ranges [m], one a beam; infinite where nothing reflects within the range, or
  /// the beam dropped out.
  void Cast(const LidarScene& scene, const ScanErrors& errors, std::span<double> ranges) const;
  /// Counts readings in the zone, beam by beam.
  SectorCounts Count(std::span<const double> ranges, const AvoidanceZone& zone) const;
  /// The same counts as Count(Cast(...)) without casting. A beam's nearest reflection lies within a zone that
  /// is star-shaped about the sensor exactly if any reflection does: so each edge, clipped to the zone, marks
  /// one run of beams, and the union of the runs is counted word by word. Only beams whose reading the range
  /// error may carry across the zone's limit are cast.
  SectorCounts CountExactly(const LidarScene& scene, const ScanErrors& errors,
                            const AvoidanceZone& zone) const;
  /// SectorCode of these counts. Casts beams for those sectors only whose bit hangs on them.
  std::uint8_t Code(const LidarScene& scene, const ScanErrors& errors, const AvoidanceZone& zone,
                    int min_points) const;

 private:
  static constexpr int kMaxWords = 64;
  using Marks = std::array<std::uint64_t, kMaxWords>;

  double Range(const ReflectingEdge& edge, int beam) const;
  double NearestRange(const LidarScene& scene, int beam) const;
  bool InZone(double range, int beam, const AvoidanceZone& zone) const;
  /// Marks the beams first .. last that the edge reflects within `far`, and `half_width` to the sides.
  void MarkEdge(const ReflectingEdge& edge, double far, double half_width, int first, int last,
                std::uint64_t* marks) const;
  /// Of the beams begin .. end - 1.
  void MarkDisc(const LidarScene& scene, double radius, double half_width, int begin, int end,
                Marks* marks) const;
  /// The same of the zone with every limit but the near one moved out by `grown`.
  void MarkZone(const LidarScene& scene, const AvoidanceZone& zone, double grown, int begin, int end,
                Marks* marks) const;
  /// Beams whose reading is in the zone whatever the range error.
  void MarkSure(const LidarScene& scene, const ScanErrors& errors, const AvoidanceZone& zone,
                Marks* sure) const;
  /// Of the beams begin .. end - 1, those whose reading the range error may carry across a limit of the zone.
  void MarkDoubtful(const LidarScene& scene, const ScanErrors& errors, const AvoidanceZone& zone,
                    const Marks& sure, int begin, int end, Marks* doubtful) const;
  /// Casts the doubtful beams of sector i, from the right. @return how many are in the zone.
  int CountDoubtful(const LidarScene& scene, const ScanErrors& errors, const AvoidanceZone& zone, int i,
                    const Marks& doubtful) const;
  /// Counts readings in the zone; a sector's count may be too small where it is above, or surely not above,
  /// `enough`. Without it all counts are exact.
  SectorCounts CountAtLeast(const LidarScene& scene, const ScanErrors& errors, const AvoidanceZone& zone,
                            std::optional<int> enough) const;
  bool IsFront(int beam) const { return beam >= front_begin() && beam < front_end(); }
  int words() const { return (beams() + 63) / 64; }
  int front_begin() const { return sector_begin_[kSectors / 2 - 1]; }
  int front_end() const { return sector_begin_[kSectors / 2 + 1]; }

  LidarParams params_;
  double first_angle_, spacing_;
  std::vector<double> x_, y_;                   // Directions of the beams.
  std::array<int, kSectors + 1> sector_begin_;  // First beam of the sectors from right to left, and the end.
};

}  // namespace lanewise
