#include "agents/v2x/inbox.h"

#include <algorithm>
#include <limits>

namespace lanewise {
namespace {

constexpr std::size_t kLeastRoom = 16;
constexpr std::int32_t kNeverSent = std::numeric_limits<std::int32_t>::min();
constexpr int kMaxSkipped = 3;  // Senders that are not heard this time.

}  // namespace

Inbox::Entry Inbox::Put(const Entry& entry, std::int32_t oldest) {
  std::int32_t position = InTurn(entry.sender);
  if (position == kNone) {
    position = PositionOf(entry.sender);
    if (position == kNone) position = Append(entry.sender, oldest);
    At(stored_).next = static_cast<std::uint16_t>(std::min<std::int32_t>(position, kNoNext));
  }
  stored_ = position;
  Known& here = At(position);
  const Entry before = here.entry();
  if (before.sent < entry.sent) {
    here.sent = entry.sent;
    here.index = entry.index;
    here.latency = static_cast<std::uint16_t>(entry.received - entry.sent);
  }
  return before.sent < oldest ? Entry{} : before;
}

std::int32_t Inbox::InTurn(StationId sender) const {
  if (known_.empty()) return kNone;
  std::int32_t position = stored_;
  for (int skipped = 0; skipped <= kMaxSkipped; ++skipped) {
    position = At(position).next;
    if (position == kNoNext) return kNone;
    if (At(position).sender == sender) return position;
  }
  return kNone;
}

std::optional<Inbox::Entry> Inbox::Find(StationId sender, std::int32_t oldest) const {
  const std::int32_t position = PositionOf(sender);
  if (position == kNone || At(position).sent < oldest) return std::nullopt;
  return At(position).entry();
}

std::int32_t Inbox::PositionOf(StationId sender) const {
  if (table_.empty()) return kNone;
  for (std::size_t at = Home(sender); table_[at] != kNone; at = (at + 1) & (table_.size() - 1)) {
    if (At(table_[at]).sender == sender) return table_[at];
  }
  return kNone;
}

std::int32_t Inbox::Append(StationId sender, std::int32_t oldest) {
  if (known_.size() >= limit_) Compact(oldest);
  // Forgotten as yet; who came after the one stored last comes after this one.
  const std::uint16_t next = known_.empty() ? kNoNext : At(stored_).next;
  known_.push_back({sender, kNeverSent, 0, 0, next});
  const auto position = static_cast<std::int32_t>(known_.size()) - 1;
  Enter(position);
  return position;
}

void Inbox::Enter(std::int32_t position) {
  std::size_t at = Home(At(position).sender);
  while (table_[at] != kNone) at = (at + 1) & (table_.size() - 1);
  table_[at] = position;
}

void Inbox::Compact(std::int32_t oldest) {
  // The table is filled anew below. Until then it holds where each entry moves to.
  std::int32_t kept = 0;
  for (std::size_t k = 0; k < known_.size(); ++k) table_[k] = known_[k].sent >= oldest ? kept++ : kNone;
  if (!known_.empty()) stored_ = std::max(table_[static_cast<std::size_t>(stored_)], 0);
  for (std::size_t k = 0; k < known_.size(); ++k) {
    if (table_[k] == kNone) continue;
    Known moved = known_[k];
    if (moved.next != kNoNext)
      moved.next = static_cast<std::uint16_t>(table_[moved.next]);  // kNone: kNoNext.
    At(table_[k]) = moved;
  }
  known_.resize(static_cast<std::size_t>(kept));
  limit_ = known_.size() + known_.size() / 4 + kLeastRoom;
  std::size_t size = std::max<std::size_t>(1, table_.size());
  while (size < 2 * limit_) size *= 2;
  table_.assign(size, kNone);
  // Room for all that can come until the table grows again: a warm step does not allocate.
  known_.reserve(size / 2);
  flying_.reserve(size);
  for (std::int32_t position = 0; position < kept; ++position) Enter(position);
}

void Inbox::Clear() {
  known_.clear();
  std::fill(table_.begin(), table_.end(), kNone);
  stored_ = 0;
  flying_.clear();
}

}  // namespace lanewise
