#pragma once

#include <fmt/core.h>

#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string>

namespace lanewise {

/// Bad input by the user: a file, an option or a parameter. The message names the file, the field,
/// what was found and what is allowed.
class ConfigError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

[[noreturn]] inline void FailCheck(const char* condition, const char* file, int line) {
  fmt::print(stderr, "lanewise: broken invariant: {} ({}:{})\n", condition, file, line);
  std::abort();
}

}  // namespace lanewise

/// A broken invariant is a bug of ours: stop loudly, in every build.
#define LANEWISE_CHECK(condition) \
  ((condition) ? void(0) : ::lanewise::FailCheck(#condition, __FILE__, __LINE__))
