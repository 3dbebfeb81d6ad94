#include "agents/coordination/signal_timing.h"

namespace lanewise {

std::optional<GreenWindow> NextGreen(const SignalTiming& timing, std::int32_t link, double after) {
  if (!timing.fixed || timing.phases.empty()) return std::nullopt;
  const auto k = static_cast<std::size_t>(link);
  const std::size_t count = timing.phases.size();
  std::optional<GreenWindow> window;
  double begin = 0.0, end = timing.to_switch;
  for (std::size_t step = 0; step <= 2 * count; ++step) {
    const SignalPhase& phase = timing.phases[(static_cast<std::size_t>(timing.phase) + step) % count];
    if (step > 0) {
      begin = end;
      end += phase.duration;
    }
    if (k < phase.state.size() && IsGreen(phase.state[k])) {
      if (!window) window = GreenWindow{begin, end};
      window->end = end;
    } else {
      if (window && window->end > after) return window;
      window.reset();
    }
  }
  return window && window->end > after ? window : std::nullopt;
}

}  // namespace lanewise
