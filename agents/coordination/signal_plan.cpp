#include "agents/coordination/signal_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "agents/core/check.h"

namespace lanewise {
namespace {

constexpr double kTolerance = 1e-6;  // [s]

/// A link of a signal, as its program sees it.
struct SignalLink {
  const Connection* connection;
  bool crossing;  // For pedestrians.
};

std::vector<SignalLink> LinksOf(const RoadNetwork& network, std::int32_t signal) {
  std::vector<SignalLink> links;
  for (const Connection& connection : network.connections) {
    if (connection.signal != signal || connection.link_index == kNone) continue;
    const EdgeIndex to = network.lanes[connection.to].edge;
    links.push_back({&connection, network.edges[to].function == EdgeFunction::kCrossing});
  }
  return links;
}

bool AreFoes(const RoadNetwork& network, const Connection& a, const Connection& b) {
  if (a.junction == kNone || a.junction != b.junction || a.request == kNone || b.request == kNone)
    return false;
  const auto& foes = network.junctions[a.junction].requests[a.request].foes;
  return static_cast<std::size_t>(b.request) < foes.size() && foes[b.request];
}

char StateIn(const SignalPhase& phase, std::int32_t link) {
  return phase.state[static_cast<std::size_t>(link)];
}

/// [s] for which `holds` is true of the phases from `first` on, all around the cycle.
template <class Holds>
double TimeWhile(std::span<const SignalPhase> phases, std::size_t first, Holds&& holds) {
  double time = 0.0;
  for (std::size_t k = 0; k < phases.size(); ++k) {
    const SignalPhase& phase = phases[(first + k) % phases.size()];
    if (!holds(phase)) break;
    time += phase.duration;
  }
  return time;
}

/// Names what is at fault.
class Complaint {
 public:
  Complaint(const RoadNetwork& network, std::int32_t signal)
      : name_(network.signal_ids[static_cast<std::size_t>(signal)]) {}
  template <class... Args>
  [[noreturn]] void operator()(std::size_t phase, fmt::format_string<Args...> text, Args&&... args) const {
    throw ConfigError(fmt::format("signal '{}', phase {}: {}", name_, phase,
                                  fmt::format(text, std::forward<Args>(args)...)));
  }

 private:
  std::string name_;
};

/// A green that begins with phase `first`: long enough, and followed by what clears it.
void CheckGreen(const RoadNetwork& network, const SignalParams& params, std::span<const SignalPhase> phases,
                std::span<const SignalLink> links, const SignalLink& link, std::size_t first,
                const Complaint& complain) {
  const Connection& connection = *link.connection;
  const std::int32_t index = connection.link_index;
  const double green =
      TimeWhile(phases, first, [&](const SignalPhase& p) { return IsGreen(StateIn(p, index)); });
  if (green < params.min_green - kTolerance)
    complain(first, "link {} is green for {} s; allowed: at least {} s", index, green, params.min_green);
  std::size_t end = first;
  while (IsGreen(StateIn(phases[end], index))) end = (end + 1) % phases.size();
  if (link.crossing) {
    const double clear = TimeWhile(phases, end, [&](const SignalPhase& p) {
      return std::none_of(links.begin(), links.end(), [&](const SignalLink& other) {
        return !other.crossing && AreFoes(network, connection, *other.connection) &&
               IsGreen(StateIn(p, other.connection->link_index));
      });
    });
    const double needed = network.lanes[connection.to].length / params.walking_speed;
    if (green + clear < needed - kTolerance)
      complain(first, "pedestrians of link {} have {} s to cross; allowed: at least {:.1f} s", index,
               green + clear, needed);
    return;
  }
  const double yellow =
      TimeWhile(phases, end, [&](const SignalPhase& p) { return IsYellow(StateIn(p, index)); });
  const double needed = MinimumYellow(network.lanes[connection.from].speed_limit);
  if (yellow < needed - kTolerance)
    complain(end, "link {} is yellow for {} s after its green; allowed: at least {} s at {:.0f} km/h", index,
             yellow, needed, 3.6 * network.lanes[connection.from].speed_limit);
}

}  // namespace

double MinimumYellow(double speed_limit) {
  const double kmh = std::round(3.6 * speed_limit);
  return kmh <= 50.0 ? 3.0 : kmh <= 60.0 ? 4.0 : 5.0;
}

void CheckSignalProgram(const RoadNetwork& network, const SignalParams& params, std::int32_t signal,
                        std::span<const SignalPhase> phases) {
  const Complaint complain(network, signal);
  const std::vector<SignalLink> links = LinksOf(network, signal);
  for (std::size_t p = 0; p < phases.size(); ++p) {
    if (!(phases[p].duration > 0.0))
      complain(p, "its duration is {} s; allowed: more than 0", phases[p].duration);
    for (const SignalLink& link : links) {
      if (static_cast<std::size_t>(link.connection->link_index) >= phases[p].state.size())
        complain(p, "its state '{}' has no link {}", phases[p].state, link.connection->link_index);
    }
  }
  for (std::size_t p = 0; p < phases.size(); ++p) {
    for (const SignalLink& link : links) {
      if (StateIn(phases[p], link.connection->link_index) != 'G') continue;
      for (const SignalLink& other : links) {
        const char foe = StateIn(phases[p], other.connection->link_index);
        if ((foe == 'G' || IsYellow(foe)) && AreFoes(network, *link.connection, *other.connection))
          complain(p, "link {} has green while its foe, link {}, has {}", link.connection->link_index,
                   other.connection->link_index, foe == 'G' ? "green" : "yellow");
      }
    }
  }
  for (std::size_t p = 0; p < phases.size(); ++p) {
    const SignalPhase& before = phases[(p + phases.size() - 1) % phases.size()];
    for (const SignalLink& link : links) {
      const std::int32_t index = link.connection->link_index;
      if (IsGreen(StateIn(phases[p], index)) && !IsGreen(StateIn(before, index)))
        CheckGreen(network, params, phases, links, link, p, complain);
    }
  }
}

std::vector<double> MinimumDurations(const RoadNetwork& network, const SignalParams& params,
                                     std::int32_t signal, std::span<const SignalPhase> phases) {
  const std::vector<SignalLink> links = LinksOf(network, signal);
  std::vector<double> minimum;
  for (std::size_t p = 0; p < phases.size(); ++p) {
    const SignalPhase& next = phases[(p + 1) % phases.size()];
    bool ends_green = false, serves_crossing = false, clears = false;
    for (const SignalLink& link : links) {
      const char state = StateIn(phases[p], link.connection->link_index);
      ends_green |= IsGreen(state) && !IsGreen(StateIn(next, link.connection->link_index));
      serves_crossing |= IsGreen(state) && link.crossing;
      clears |= IsYellow(state);
    }
    const bool may_shrink = ends_green && !serves_crossing && !clears;
    minimum.push_back(may_shrink ? std::min(params.min_green, phases[p].duration) : phases[p].duration);
  }
  return minimum;
}

void CheckPlan(const RoadNetwork& network, const SignalParams& params, std::int32_t signal,
               std::span<const SignalPhase> phases, std::span<const double> minimum,
               std::span<const double> plan) {
  const Complaint complain(network, signal);
  double change = 0.0;
  for (std::size_t p = 0; p < phases.size(); ++p) {
    const bool fixed = minimum[p] >= phases[p].duration;
    if (plan[p] < minimum[p] - kTolerance)
      complain(p, "the plan gives it {} s; allowed: at least {} s", plan[p], minimum[p]);
    if (fixed && plan[p] > phases[p].duration + kTolerance)
      complain(p, "the plan gives it {} s; allowed: its {} s", plan[p], phases[p].duration);
    change += plan[p] - phases[p].duration;
  }
  if (std::abs(change) > params.max_cycle_change + kTolerance)
    complain(0, "the plan changes the cycle by {} s; allowed: up to {} s", change, params.max_cycle_change);
}

}  // namespace lanewise
