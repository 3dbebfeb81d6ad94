#pragma once

#include <signal.h>

namespace lanewise {

/// Turns SIGINT and SIGTERM into a flag while it lives; a second one ends the process as usual.
class InterruptGuard {
 public:
  InterruptGuard();
  ~InterruptGuard();
  InterruptGuard(const InterruptGuard&) = delete;
  InterruptGuard& operator=(const InterruptGuard&) = delete;

 private:
  struct sigaction old_int_ {};
  struct sigaction old_term_ {};
};

/// Since the last guard was made.
bool Interrupted();

}  // namespace lanewise
