#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "agents/core/types.h"

namespace lanewise {

/// Uniform grid over points, rebuilt each step by counting sort in index order: the content of a
/// cell, and so every query's order, does not depend on the number of threads. Cells are hashed, so the
/// memory does not grow with the network's extent; after warm-up Build does not allocate.
class SpatialGrid {
 public:
  explicit SpatialGrid(double cell_size) : cell_size_(cell_size) {}

  /// Indexes points (x[i], y[i]) [m].
  void Build(std::span<const double> x, std::span<const double> y);

  /// Calls visit(index) once for every point in the cells within `radius` [m] of (x, y): a superset
  /// of the points within that radius; the caller tests the distance. Indices of one cell come in ascending
  /// order.
  template <class Visitor>
  void ForEachNear(double x, double y, double radius, Visitor&& visit) const {
    ForEachNearIf(
        x, y, radius, [](std::uint32_t) { return true; }, visit);
  }

  /// Points in the order in which queries read them: items()[slot] is the index of a point.
  std::span<const AgentIndex> items() const { return items_; }
  /// Like ForEachNear, for those for whose slot accept(slot) is true. Who keeps what it tests by slot reads
  /// memory in runs. accept is called for some points of other cells too.
  template <class Accept, class Visitor>
  void ForEachNearIf(double x, double y, double radius, Accept&& accept, Visitor&& visit) const;
  /// Fills `slots` with the slots of the points whose distance2(slot) [m^2] from (x, y) is at most radius^2,
  /// and `distances2` with those; returns how many: for where many are near, as no branch depends on what
  /// is read. Both vectors keep a length of one more than there are points. distance2 is called for some
  /// points of other cells too.
  template <class Distance2>
  std::size_t SlotsWithin(double x, double y, double radius, Distance2&& distance2,
                          std::vector<std::uint32_t>* slots, std::vector<double>* distances2) const;

 private:
  /// Column or row of a coordinate. Saturates far outside any map (and for NaN), so the cast is defined.
  std::int32_t CellOf(double coordinate) const {
    double scaled = coordinate / cell_size_;
    scaled = scaled > -2e9 ? scaled : -2e9;  // Comparisons inline; std::fmax would be a call.
    scaled = scaled < 2e9 ? scaled : 2e9;
    const auto truncated = static_cast<std::int32_t>(scaled);
    return truncated - (scaled < static_cast<double>(truncated) ? 1 : 0);
  }
  /// One number for a cell; the cells of a column are consecutive in ascending row.
  static std::int64_t Pack(std::int32_t column, std::int32_t row) {
    return static_cast<std::int64_t>(column) * (std::int64_t{1} << 32) + row;
  }
  /// The cells of a column fill consecutive buckets (cyclically): a query reads memory in runs.
  std::uint32_t BucketOf(std::int32_t column, std::int32_t row) const {
    std::uint32_t hash = static_cast<std::uint32_t>(column) * 0x9E3779B1u;
    hash ^= hash >> 15;
    return (hash + static_cast<std::uint32_t>(row)) & mask_;
  }

  /// Calls run(begin, end, first, last) for runs of slots that together hold the points of ForEachNear once:
  /// those whose item_cell_ is first .. last. A bucket may hold items of other cells.
  template <class Run>
  void ForEachRun(double x, double y, double radius, Run&& run) const;

  double cell_size_;
  std::uint32_t mask_{0};                 // Buckets - 1; buckets are a power of two >= 2 * points.
  std::vector<std::uint32_t> start_;      // By bucket, length buckets + 1.
  std::vector<AgentIndex> items_;         // Point indices grouped by bucket.
  std::vector<std::int64_t> item_cell_;   // Packed cell of each item: hash collisions are skipped by it.
  std::vector<std::uint32_t> bucket_of_;  // Scratch, by point.
};

template <class Accept, class Visitor>
void SpatialGrid::ForEachNearIf(double x, double y, double radius, Accept&& accept, Visitor&& visit) const {
  ForEachRun(x, y, radius,
             [&](std::uint32_t begin, std::uint32_t end, std::int64_t first, std::int64_t last) {
               for (std::uint32_t k = begin; k < end; ++k) {
                 if (accept(k) && item_cell_[k] >= first && item_cell_[k] <= last) visit(items_[k]);
               }
             });
}

template <class Distance2>
std::size_t SpatialGrid::SlotsWithin(double x, double y, double radius, Distance2&& distance2,
                                     std::vector<std::uint32_t>* slots,
                                     std::vector<double>* distances2) const {
  slots->resize(items_.size() + 1);  // The last is written to, never kept.
  distances2->resize(items_.size() + 1);
  std::uint32_t* const slot = slots->data();
  double* const near2 = distances2->data();
  const double radius2 = radius * radius;
  std::size_t count = 0;
  ForEachRun(x, y, radius,
             [&](std::uint32_t begin, std::uint32_t end, std::int64_t first, std::int64_t last) {
               const auto cells = static_cast<std::uint64_t>(last - first);
               std::size_t next = count;
               for (std::uint32_t k = begin; k < end; ++k) {
                 slot[next] = k;
                 near2[next] = distance2(k);
                 next += static_cast<std::size_t>(near2[next] <= radius2) &
                         static_cast<std::size_t>(static_cast<std::uint64_t>(item_cell_[k] - first) <= cells);
               }
               count = next;
             });
  return count;
}

template <class Run>
void SpatialGrid::ForEachRun(double x, double y, double radius, Run&& run) const {
  if (items_.empty()) return;
  const std::int32_t first_row = CellOf(y - radius);
  const std::int32_t last_row = CellOf(y + radius);
  const std::int64_t rows = static_cast<std::int64_t>(last_row) - first_row + 1;
  const std::int32_t first_column = CellOf(x - radius);
  const std::int32_t last_column = CellOf(x + radius);
  const std::int64_t columns = static_cast<std::int64_t>(last_column) - first_column + 1;

  const auto item_count = static_cast<std::uint32_t>(items_.size());
  // More rows than buckets would meet items twice; beyond the number of items walking them all is cheaper
  // too.
  if (rows > item_count || columns > item_count) {
    for (std::uint32_t k = 0; k < item_count; ++k) {
      const std::int64_t column = (item_cell_[k] + (std::int64_t{1} << 31)) >> 32;
      if (column >= first_column && column <= last_column) {
        run(k, k + 1, Pack(static_cast<std::int32_t>(column), first_row),
            Pack(static_cast<std::int32_t>(column), last_row));
      }
    }
    return;
  }
  for (std::int32_t column = first_column; column <= last_column; ++column) {
    const std::int64_t first = Pack(column, first_row);
    const std::int64_t last = Pack(column, last_row);
    const std::uint32_t begin = BucketOf(column, first_row);
    const std::uint32_t end = BucketOf(column, last_row) + 1;
    if (begin < end) {
      run(start_[begin], start_[end], first, last);
    } else {  // Around the end of the table.
      run(start_[begin], item_count, first, last);
      run(0, start_[end], first, last);
    }
  }
}

}  // namespace lanewise
