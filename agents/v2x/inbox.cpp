#include "agents/v2x/inbox.h"

#include <algorithm>

namespace lanewise {
namespace {

constexpr std::size_t kLeastSize = 16;

}  // namespace

Inbox::Entry Inbox::Put(const Entry& entry, std::int32_t oldest) {
  if (2 * used_ >= table_.size()) Rehash(oldest);
  Entry* reusable = nullptr;
  for (std::size_t at = Home(entry.sender);; at = (at + 1) & (table_.size() - 1)) {
    Entry& here = table_[at];
    if (here.sender == entry.sender) {
      const Entry before = here;
      if (before.sent < oldest) {
        here = entry;
        return {};
      }
      if (before.sent < entry.sent) here = entry;
      return before;
    }
    if (here.sender == kNone) {
      if (reusable == nullptr) ++used_;
      *(reusable == nullptr ? &here : reusable) = entry;
      return {};
    }
    if (reusable == nullptr && here.sent < oldest) reusable = &here;
  }
}

const Inbox::Entry* Inbox::Find(StationId sender, std::int32_t oldest) const {
  if (table_.empty()) return nullptr;
  for (std::size_t at = Home(sender); table_[at].sender != kNone; at = (at + 1) & (table_.size() - 1)) {
    if (table_[at].sender == sender) return table_[at].sent >= oldest ? &table_[at] : nullptr;
  }
  return nullptr;
}

void Inbox::Rehash(std::int32_t oldest) {
  spare_.clear();
  ForEach(oldest, [&](const Entry& entry) { spare_.push_back(entry); });
  std::size_t size = std::max(kLeastSize, table_.size());
  while (4 * (spare_.size() + 1) > size) size *= 2;
  table_.assign(size, {});
  // Room for all that can come until the next doubling: a warm step does not allocate.
  spare_.reserve(size / 2);
  flying_.reserve(size);
  used_ = spare_.size();
  for (const Entry& entry : spare_) {
    std::size_t at = Home(entry.sender);
    while (table_[at].sender != kNone) at = (at + 1) & (size - 1);
    table_[at] = entry;
  }
}

void Inbox::Clear() {
  std::fill(table_.begin(), table_.end(), Entry{});
  used_ = 0;
  flying_.clear();
}

}  // namespace lanewise
