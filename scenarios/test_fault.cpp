#include "scenarios/test_fault.h"

#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <string>

namespace lanewise {

TestFault::TestFault(std::int64_t seed) {
  const char* text = std::getenv("LANEWISE_TEST_FAULT");
  char kind[16] = "";
  long long of_seed = 0;
  if (text == nullptr || std::sscanf(text, "%15s %lld %lf", kind, &of_seed, &value_) != 3 || of_seed != seed)
    return;
  const std::string name = kind;
  kind_ = name == "abort"  ? Kind::kAbort
          : name == "hang" ? Kind::kHang
          : name == "full" ? Kind::kFull
                           : Kind::kNone;
}

void TestFault::Step(double time) const {
  if (kind_ == Kind::kNone || kind_ == Kind::kFull || time < value_) return;
  if (kind_ == Kind::kAbort) std::abort();
  while (true) ::pause();
}

std::int64_t TestFault::max_file_bytes() const {
  return kind_ == Kind::kFull ? static_cast<std::int64_t>(value_) : 0;
}

}  // namespace lanewise
