#include "agents/planning/way_search.h"

#include <algorithm>
#include <cmath>

#include "agents/core/check.h"

namespace lanewise {
namespace {

constexpr double kLayer = 1.0;  // [m]
constexpr int kPointsPerLayer = static_cast<int>(kLayer / Way::kSpacing);
constexpr int kMaxLayers = (Way::kMaxPoints - 1) / kPointsPerLayer;
/// Slip angles: -3 .. 3 steps.
constexpr double kSlipStep = 0.15;  // [rad]
constexpr int kSlipSteps = 3;
/// Cells of which one node is expanded.
constexpr double kCellD = 0.15, kCellHeading = 0.08;  // [m], [rad]
constexpr int kDCells = 200, kHeadingCells = 24;
/// Expansions after which a search gives up.
constexpr int kMaxExpanded = 40000;
/// How much deeper nodes are preferred: 1 would find the cheapest way, more finds a good one much sooner.
constexpr float kGreed = 1.6f;

/// Cost of a metre: itself 1.
constexpr double kCostOff = 0.02, kCostCourse = 0.2, kCostTurn = 0.15, kCostNear = 1.0;
/// [m] Gaps beyond are not told apart.
constexpr double kFarGap = 3.0;

/// The bicycle's motion over one spacing of road. @return false if it turns too far from the road.
bool Advance(double slip, double l_r, double max_course, double* d, double* heading) {
  const double course = *heading + slip;
  if (std::abs(course) > max_course) return false;
  const double turn = Way::kSpacing / std::cos(course) * std::sin(slip) / l_r;
  const double middle = course + 0.5 * turn;
  if (std::abs(course + turn) > max_course) return false;
  *d += Way::kSpacing * std::tan(middle);
  *heading += turn;
  return true;
}

}  // namespace

double Way::At(const std::array<float, kMaxPoints>& values, double s) const {
  const double at = std::clamp((s - begin_s) / kSpacing, 0.0, static_cast<double>(count - 1));
  const int k = std::min(static_cast<int>(at), std::max(0, count - 2));
  if (count < 2) return values[0];
  return values[k] + (at - k) * (values[k + 1] - values[k]);
}

double WaySearch::Gap(const WayTask& task, double s, double d, double heading) const {
  const VehicleParams& v = *task.vehicle;
  const double c = std::cos(heading), n = std::sin(heading);
  const double half_length = 0.5 * v.length, half_width = 0.5 * v.width;
  const double x = s - half_length * c, y = d - half_length * n;
  const double extent = half_length * std::abs(n) + half_width * c;
  double gap = std::min({kFarGap, task.left - y - extent, y - extent - task.right});
  const double reach = std::hypot(half_length, half_width) + task.comfort;
  const Footprint ego{{s, d, heading}, v.length, v.width};
  for (const Thing& thing : things_) {
    const double dx = thing.x - x, dy = thing.y - y, near = reach + thing.reach;
    if (dx * dx + dy * dy > near * near) continue;
    gap = std::min(gap, -PenetrationDepth(ego, thing.box));
    if (gap < 0.0) break;
  }
  return gap;
}

std::size_t WaySearch::Cell(const WayTask& task, const Node& node) const {
  const int d = std::clamp(static_cast<int>((node.d - task.right) / kCellD), 0, kDCells - 1);
  const int heading =
      std::clamp(static_cast<int>(node.heading / kCellHeading + 0.5 * kHeadingCells), 0, kHeadingCells - 1);
  return ((static_cast<std::size_t>(node.layer) * kDCells + d) * kHeadingCells + heading) *
             (2 * kSlipSteps + 1) +
         (node.slip + kSlipSteps);
}

void WaySearch::Push(const Node& node, int layers) {
  nodes_.push_back(node);
  const float rest = static_cast<float>(layers - node.layer);
  open_.push_back({node.cost + kGreed * rest, static_cast<std::int32_t>(nodes_.size()) - 1});
  std::push_heap(open_.begin(), open_.end(), [](const Open& a, const Open& b) {
    return a.priority != b.priority ? a.priority > b.priority : a.node < b.node;
  });
}

bool WaySearch::Search(const WayTask& task, Way* way) {
  LANEWISE_CHECK(task.vehicle != nullptr);
  const double l_r = task.vehicle->rear_axle_to_front;
  const int layers =
      std::clamp(static_cast<int>(std::ceil((task.end_s - task.start.x) / kLayer)), 1, kMaxLayers);
  closed_.resize(static_cast<std::size_t>(kMaxLayers + 1) * kDCells * kHeadingCells * (2 * kSlipSteps + 1));
  ++search_;
  nodes_.clear();
  open_.clear();
  things_.clear();
  for (const Footprint& box : task.things) {
    things_.push_back({box, box.front.x - 0.5 * box.length * std::cos(box.front.heading),
                       box.front.y - 0.5 * box.length * std::sin(box.front.heading),
                       0.5 * std::hypot(box.length, box.width)});
  }
  expanded_ = 0;
  // Where the start itself is too near to something, a way must not come nearer.
  const double margin =
      std::min(task.margin, Gap(task, task.start.x, task.start.y, task.start.heading) - 0.01);
  const auto slip0 = static_cast<std::int8_t>(
      std::clamp(static_cast<int>(std::lround(task.slip / kSlipStep)), -kSlipSteps, kSlipSteps));
  Push({static_cast<float>(task.start.y), static_cast<float>(task.start.heading), 0.0f, -1, 0, slip0},
       layers);
  std::int32_t deepest = 0;
  while (!open_.empty() && expanded_ < kMaxExpanded) {
    std::pop_heap(open_.begin(), open_.end(), [](const Open& a, const Open& b) {
      return a.priority != b.priority ? a.priority > b.priority : a.node < b.node;
    });
    const std::int32_t index = open_.back().node;
    open_.pop_back();
    const Node node = nodes_[index];
    std::uint32_t& closed = closed_[Cell(task, node)];
    if (closed == search_) continue;
    closed = search_;
    ++expanded_;
    if (node.layer > nodes_[deepest].layer) deepest = index;
    if (node.layer == layers) break;
    for (int change = -1; change <= 1; ++change) {
      const int steps = node.slip + change;
      if (std::abs(steps) > kSlipSteps) continue;
      const double slip = steps * kSlipStep;
      double d = node.d, heading = node.heading, s = task.start.x + node.layer * kLayer, cost = 0.0;
      bool admissible = true;
      for (int k = 0; k < kPointsPerLayer && admissible; ++k) {
        admissible = Advance(slip, l_r, task.max_course, &d, &heading);
        if (!admissible) break;
        s += Way::kSpacing;
        const double gap = Gap(task, s, d, heading);
        admissible = gap >= margin && (s > task.side_until || (d >= task.side_min && d <= task.side_max));
        cost += kCostNear / kPointsPerLayer * std::max(0.0, 1.0 - gap / task.comfort);
      }
      if (!admissible) continue;
      cost +=
          kLayer * (1.0 + kCostOff * std::abs(d - task.target_d) + kCostCourse * std::abs(heading + slip)) +
          kCostTurn * (std::abs(change) + 0.3 * std::abs(steps));
      Push({static_cast<float>(d), static_cast<float>(heading), node.cost + static_cast<float>(cost), index,
            static_cast<std::int16_t>(node.layer + 1), static_cast<std::int8_t>(steps)},
           layers);
    }
  }

  way->begin_s = task.start.x;
  way->complete = nodes_[deepest].layer == layers;
  way->count = nodes_[deepest].layer * kPointsPerLayer + 1;
  std::array<std::int8_t, kMaxLayers> slips{};
  for (std::int32_t k = deepest; nodes_[k].parent >= 0; k = nodes_[k].parent)
    slips[nodes_[k].layer - 1] = nodes_[k].slip;
  double d = task.start.y, heading = task.start.heading;
  for (int k = 0; k < way->count; ++k) {
    const double slip = kSlipStep * slips[std::min(k / kPointsPerLayer, kMaxLayers - 1)];
    way->d[k] = static_cast<float>(d);
    way->heading[k] = static_cast<float>(heading);
    way->slip[k] = static_cast<float>(k + 1 < way->count ? slip : (k > 0 ? way->slip[k - 1] : 0.0f));
    way->gap[k] = static_cast<float>(Gap(task, task.start.x + k * Way::kSpacing, d, heading));
    if (k + 1 < way->count) Advance(slip, l_r, task.max_course, &d, &heading);
  }
  return way->complete;
}

}  // namespace lanewise
