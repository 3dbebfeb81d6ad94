#pragma once

#include <cstdint>
#include <vector>

#include "agents/v2x/message.h"

namespace lanewise {

/// What a receiver knows of each sender: where the last message it got is kept. A hash table by sender with
/// linear probing; entries that are too old are reused, and dropped when it grows.
class Inbox {
 public:
  struct Entry {
    StationId sender{kNone};
    std::int32_t sent{0};      ///< Step in which the message was generated.
    std::int32_t received{0};  ///< Step from which it was known.
    std::int32_t index{0};     ///< Of the message among those of its step.
  };

  /// Stores `entry` unless a later message of the same sender is known. Entries sent before `oldest` count
  /// as forgotten. @return the entry it replaces; sender kNone if there was none, or it was forgotten.
  Entry Put(const Entry& entry, std::int32_t oldest);
  /// Has the memory fetched that Put will need: an inbox lies cold from one step to the next.
  void Prefetch(StationId sender) const {
    if (!table_.empty()) __builtin_prefetch(&table_[Home(sender)], 1);
  }
  /// Null if nothing sent at or after `oldest` is known.
  const Entry* Find(StationId sender, std::int32_t oldest) const;
  /// Calls visit(entry) for all sent at or after `oldest`, in no order that means anything.
  template <class Visitor>
  void ForEach(std::int32_t oldest, Visitor&& visit) const {
    for (const Entry& entry : table_) {
      if (entry.sender != kNone && entry.sent >= oldest) visit(entry);
    }
  }
  /// A message that is on its way until step `entry.received`.
  void Send(const Entry& entry) { flying_.push_back(entry); }
  /// Prefetch for all that are on their way.
  void PrefetchArrivals() const {
    for (const Entry& entry : flying_) Prefetch(entry.sender);
  }
  /// Calls land(entry) for what has arrived by `step`, in the order in which it was sent. `land` may call
  /// Put.
  template <class Land>
  void Arrive(std::int32_t step, Land&& land) {
    std::size_t kept = 0;
    for (std::size_t k = 0; k < flying_.size(); ++k) {
      const Entry entry = flying_[k];  // A copy: Put may make room.
      if (entry.received <= step) {
        land(entry);
      } else {
        flying_[kept++] = entry;
      }
    }
    flying_.resize(kept);
  }
  void Clear();

 private:
  std::size_t Home(StationId sender) const {
    return (static_cast<std::uint32_t>(sender) * 0x9E3779B1u >> 7) & (table_.size() - 1);
  }
  /// Makes room: forgets what is too old, doubles if that is not enough.
  void Rehash(std::int32_t oldest);

  std::vector<Entry> table_, spare_;  // Powers of two, or empty.
  std::size_t used_{0};               // Of the table, forgotten ones included.
  std::vector<Entry> flying_;
};

}  // namespace lanewise
