#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace lanewise {

/// A phase of a signal program.
struct SignalPhase {
  double duration{0.0};  ///< [s]
  std::string state;     ///< SUMO's letter by link index: G, g green; y, Y yellow; r red; ...
};

/// What a signal shows, and will show: its program and where it is in it.
struct SignalTiming {
  bool fixed{false};  ///< Its phases have set durations; without, nobody can foresee it.
  std::vector<SignalPhase> phases;
  std::int32_t phase{0};  ///< The present one.
  double to_switch{0.0};  ///< [s] until it ends.
};

inline bool IsGreen(char state) {
  return state == 'G' || state == 'g';
}
inline bool IsYellow(char state) {
  return state == 'y' || state == 'Y';
}

/// [s] from now; begin 0: it is green now.
struct GreenWindow {
  double begin, end;
};

/// The first time a link is green for at least a moment behind `after` [s] from now, looking two cycles
/// ahead; nothing if it is not green by then, or cannot be foreseen.
std::optional<GreenWindow> NextGreen(const SignalTiming& timing, std::int32_t link, double after);

}  // namespace lanewise
