#pragma once

#include <cstdint>

namespace lanewise {

/// Calls of operator new in this process so far, all threads together. Linking no_alloc.cpp replaces the
/// global operators by counting ones.
std::int64_t AllocationCount();

/// Allocations since its construction.
class AllocationCounter {
 public:
  AllocationCounter() : start_(AllocationCount()) {}
  std::int64_t count() const { return AllocationCount() - start_; }

 private:
  std::int64_t start_;
};

}  // namespace lanewise
