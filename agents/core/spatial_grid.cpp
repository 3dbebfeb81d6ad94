#include "agents/core/spatial_grid.h"

#include <bit>

#include "agents/core/check.h"

namespace lanewise {

void SpatialGrid::Build(std::span<const double> x, std::span<const double> y) {
  LANEWISE_CHECK(x.size() == y.size());
  LANEWISE_CHECK(cell_size_ > 0.0);
  const std::size_t points = x.size();
  const std::uint32_t buckets = std::bit_ceil(static_cast<std::uint32_t>(2 * points + 1));
  mask_ = buckets - 1;
  items_.resize(points);
  item_cell_.resize(points);
  bucket_of_.resize(points);
  start_.assign(buckets + 1, 0);

  for (std::size_t i = 0; i < points; ++i) {
    bucket_of_[i] = BucketOf(CellOf(x[i]), CellOf(y[i]));
    ++start_[bucket_of_[i]];
  }
  std::uint32_t end = 0;
  for (std::uint32_t& start : start_) start = end += start;
  // start_ holds the ends now. Filling from behind turns them into starts and keeps index order.
  for (std::size_t i = points; i-- > 0;) {
    const std::uint32_t slot = --start_[bucket_of_[i]];
    items_[slot] = static_cast<AgentIndex>(i);
    item_cell_[slot] = Pack(CellOf(x[i]), CellOf(y[i]));
  }
}

}  // namespace lanewise
