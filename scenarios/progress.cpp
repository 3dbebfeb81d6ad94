#include "scenarios/progress.h"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>

namespace lanewise {
namespace {

std::string Minutes(double seconds) {
  const auto whole = static_cast<std::int64_t>(seconds + 0.5);
  return fmt::format("{}:{:02}", whole / 60, whole % 60);
}

}  // namespace

Progress::Progress(std::string label, std::optional<double> end, bool quiet, int fd)
    : label_(std::move(label)),
      end_(end),
      quiet_(quiet),
      terminal_(isatty(STDERR_FILENO) != 0),
      fd_(fd),
      started_(Clock::now()),
      last_shown_(started_) {}

Progress::~Progress() {
  if (terminal_ && shown_) fmt::print(stderr, "\n");
}

void Progress::Update(double time, std::int64_t running, std::int64_t arrived, std::int64_t expected) {
  const auto now = Clock::now();
  if (fd_ >= 0 && now - last_told_ >= std::chrono::milliseconds(250)) {
    last_told_ = now;
    const std::string line =
        fmt::format("{} {} {} {} {}\n", time, end_.value_or(-1.0), running, arrived, expected);
    if (::write(fd_, line.data(), line.size()) < 0) fd_ = -1;  // Nobody listens any more.
  }
  if (quiet_) return;
  const double since = std::chrono::duration<double>(now - last_shown_).count();
  if (since < (terminal_ ? 0.5 : 10.0)) return;
  last_shown_ = now;
  shown_ = true;
  const double wall = std::chrono::duration<double>(now - started_).count();
  // Time left by vehicles (those SUMO has loaded) and, where the end is given, by time; the sooner of both.
  double left = arrived > 0 ? wall * static_cast<double>(expected) / static_cast<double>(arrived) : -1.0;
  if (end_ && time > 0.0) {
    const double by_time = wall * (*end_ - time) / time;
    left = left < 0.0 ? by_time : std::min(left, by_time);
  }
  fmt::print(stderr, "{}{}: t = {:.0f} s, {} vehicles, {} arrived, {:.1f} x real time, {}{}",
             terminal_ ? "\r\x1b[K" : "", label_, time, running, arrived, time / wall,
             left < 0.0 ? "time left unknown" : "about " + Minutes(left) + " left", terminal_ ? "" : "\n");
  std::fflush(stderr);
}

}  // namespace lanewise
