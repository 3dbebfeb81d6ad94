#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "agents/v2x/message.h"

namespace lanewise {

/// What a receiver knows of each sender: where the last message it got is kept. Entries lie close together,
/// so that an inbox which is cold from one step to the next is soon there. Messages arrive in nearly the same
/// order in every step: each entry notes which one is stored after it, and a hash table by sender finds those
/// that come out of turn. Entries that are too old are dropped when room is needed.
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
  /// Has the memory fetched that Put and Arrive will need.
  void Prefetch() const {
    constexpr std::size_t kLine = 64;  // [B]
    const auto fetch = [](const auto& items) {
      const char* bytes = reinterpret_cast<const char*>(items.data());
      for (std::size_t k = 0; k < items.size() * sizeof(items[0]); k += kLine)
        __builtin_prefetch(bytes + k, 1);
    };
    fetch(known_);
    fetch(flying_);
  }
  /// Nothing if nothing sent at or after `oldest` is known.
  std::optional<Entry> Find(StationId sender, std::int32_t oldest) const;
  /// Calls visit(entry) for all sent at or after `oldest`, in no order that means anything.
  template <class Visitor>
  void ForEach(std::int32_t oldest, Visitor&& visit) const {
    for (const Known& known : known_) {
      if (known.sent >= oldest) visit(known.entry());
    }
  }
  /// A message that is on its way until step `entry.received`.
  void Send(const Entry& entry) { flying_.push_back(entry); }
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
  static constexpr std::uint16_t kNoNext = 0xffff;
  /// An entry in four words.
  struct Known {
    StationId sender;
    std::int32_t sent, index;
    std::uint16_t latency;  // received - sent; 60 s are 60,000 steps at most.
    std::uint16_t next;     // Position of the entry to be stored after this one, if it is below kNoNext.

    Entry entry() const { return {sender, sent, sent + latency, index}; }
  };

  std::size_t Home(StationId sender) const {
    return (static_cast<std::uint32_t>(sender) * 0x9E3779B1u >> 7) & (table_.size() - 1);
  }
  Known& At(std::int32_t position) { return known_[static_cast<std::size_t>(position)]; }
  const Known& At(std::int32_t position) const { return known_[static_cast<std::size_t>(position)]; }
  /// Position of the sender if it is one of the next to come; kNone if not.
  std::int32_t InTurn(StationId sender) const;
  /// In known_; kNone if it is not there.
  std::int32_t PositionOf(StationId sender) const;
  std::int32_t Append(StationId sender, std::int32_t oldest);
  void Enter(std::int32_t position);
  /// Makes room: forgets what is too old, doubles the table if that is not enough.
  void Compact(std::int32_t oldest);

  std::vector<Known> known_;
  std::vector<std::int32_t> table_;  // Positions, by hash of the sender; a power of two, or empty.
  std::size_t limit_{0};             // Length of known_ at which it is compacted.
  std::int32_t stored_{0};           // Position of the entry stored last.
  std::vector<Entry> flying_;
};

}  // namespace lanewise
