#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "agents/agent_params.h"
#include "agents/core/random.h"
#include "agents/core/spatial_grid.h"
#include "agents/network/road_network.h"
#include "agents/traffic.h"
#include "agents/v2x/channel_counts.h"
#include "agents/v2x/inbox.h"
#include "agents/v2x/message.h"
#include "agents/v2x/reception.h"
#include "agents/v2x/v2x_level.h"

namespace lanewise {

/// The radio channel. Vehicles that carry a radio send cooperative awareness messages by the trigger rules of
/// ETSI EN 302 637-2, roadside units what is posted for them; every station keeps the last message it got of
/// each other one. Whether and when a message arrives is a function of (seed, sender, receiver, step), of
/// their distance and of the load: the same for every number of threads. After warm-up a step does not
/// allocate.
class Channel {
 public:
  Channel(const RoadNetwork& network, const V2xParams& params);

  void Open(V2xLevel level, std::uint64_t seed);
  V2xLevel level() const { return level_; }
  bool open() const { return level_ != V2xLevel::kOff; }

  /// A radio beside the road, for the rest of the run. `name` is what its draws depend on.
  StationId AddRoadsideUnit(double x, double y, std::string_view name);
  /// Has a roadside unit send a message of `bytes` in the next Exchange.
  void Post(StationId unit, std::uint64_t payload, double bytes);

  /// One step: who has to sends, who hears it keeps it. Before the agents decide.
  void Exchange(double dt, const Traffic& traffic);

  /// The last message `receiver` has of `sender`, if it got one in the last v2x.memory seconds.
  std::optional<Received> LastFrom(StationId receiver, StationId sender) const;
  /// Calls visit(Received) for the last message of every sender `receiver` knows, in no order that means
  /// anything.
  template <class Visitor>
  void ForEachKnown(StationId receiver, Visitor&& visit) const;
  bool IsEquipped(StationId station) const;

  const ChannelCounts& counts() const { return counts_; }
  /// Channel busy ratio a station measured in the last Exchange; kLoaded only.
  double BusyRatio(StationId station) const;

 private:
  /// State of the CAM trigger rules; the names are the standard's.
  struct CamState {
    std::int32_t last_step{-1};  // -1: none sent yet.
    double x{0.0}, y{0.0}, heading{0.0}, speed{0.0};
    double t_gen_cam{0.0};  // [s]
    std::int32_t n_gen_cam{0};
  };
  struct Station {
    StationId id{kNone};   // kNone: a free slot.
    std::uint64_t key{0};  // For draws.
    bool equipped{false};
    bool on_air{false};     // Equipped, and on the road in this step.
    std::int32_t seen{-1};  // Last step in which it was there.
    double x{0.0}, y{0.0};  // [m]
    double busy{0.0};
    StationId follows{kNone};   // By cooperative cruise.
    std::int32_t followed{-1};  // Last step in which it knew of one that cruises behind it.
    CamState cam;
    Inbox inbox;
    std::vector<std::uint32_t> due;  // Slots of the last step's senders whose messages are here in this one.
    Inbox::Entry latest;             // Its own last message, for kIdeal.
  };
  /// A sender of this step.
  struct Sender {
    RandomStream draws{0, 0, RandomPurpose::kRadioDelivery, 0};
    StationId id{kNone};
    std::int32_t index{0};  // Of its message in the log.
  };
  struct Posted {
    StationId unit;
    std::uint64_t payload;
    double bytes;
  };
  /// Of one thread.
  struct Scratch {
    std::vector<std::uint32_t> near;  // Slots of the senders in range,
    std::vector<double> near2;        // and their squared distances [m^2].
    std::array<std::int64_t, kFates> fates{};
    /// ages[k]: pairs whose messages begin to be k steps old, less those that stop to be k - 1 steps old.
    std::vector<std::int64_t> ages;
  };

  std::size_t Enroll(StationId id, std::uint64_t key);
  void EnrollVehicles(const Traffic& traffic);
  /// A station that is off the road takes what is due when it is back.
  void Delay(Station* station);
  /// Notes for each vehicle whether it knows by a message that another one cruises behind it.
  void NoteFollowers(const Traffic& traffic);
  bool MustSend(double dt, const Motion& now, std::size_t row, bool in_platoon, CamState* cam) const;
  Message Describe(const Traffic& traffic, std::size_t row, std::uint64_t key) const;
  void Send(Station* station, const Message& message, double bytes);
  void Generate(double dt, const Traffic& traffic);
  void SortSenders();
  void Receive(double dt, Station* receiver, Scratch* scratch);
  /// What becomes of the messages of the first `count` in scratch->near.
  void Deliver(std::size_t count, Station* receiver, Scratch* scratch) const;
  void Keep(const Inbox::Entry& entry, Station* receiver, Scratch* scratch) const;
  /// Counts the ages of a message from when it was known until the next one is, for `pairs` receivers.
  void CountAges(const Inbox::Entry& before, std::int64_t pairs, Scratch* scratch) const;
  void Gather();
  const Station* Find(StationId station) const;
  const Message& MessageOf(const Inbox::Entry& entry) const {
    return log_[static_cast<std::size_t>(entry.sent) % log_.size()][static_cast<std::size_t>(entry.index)];
  }
  Received AsReceived(const Inbox::Entry& entry) const {
    return {&MessageOf(entry), (step_ - entry.sent) * dt_};
  }

  const RoadNetwork& network_;
  V2xParams params_;
  V2xLevel level_{V2xLevel::kOff};
  std::uint64_t seed_{0};
  std::int32_t step_{-1};
  double dt_{0.1};          // [s]
  std::int32_t oldest_{0};  // Step from which messages are remembered.
  std::int64_t on_air_{0};  // Stations, now.
  Reception reception_;
  std::vector<Station> stations_;
  std::vector<std::size_t> free_;           // Slots of stations_.
  std::vector<std::int32_t> vehicle_slot_;  // By vehicle number; kNone: none.
  std::vector<std::size_t> roadside_slot_;  // By unit.
  std::vector<Posted> posted_;
  std::vector<std::vector<Message>> log_;  // By step modulo its size: messages sent then.
  std::vector<Sender> senders_;            // Of this step, in order of rows;
  std::vector<double> sender_x_, sender_y_, sender_airtime_;
  std::vector<Sender> slot_sender_;  // and in the grid's order, in which receivers read them.
  std::vector<Sender> last_slot_sender_;
  std::vector<double> slot_x_, slot_y_, slot_airtime_;
  SpatialGrid grid_;
  std::vector<std::size_t> receiver_;  // Slots of stations on the air,
  std::vector<double> receiver_x_, receiver_y_;
  SpatialGrid receiver_grid_;     // taken in the order of this grid: neighbors read the same senders.
  std::vector<Scratch> scratch_;  // By thread.
  ChannelCounts counts_;
};

template <class Visitor>
void Channel::ForEachKnown(StationId receiver, Visitor&& visit) const {
  const Station* station = Find(receiver);
  if (station == nullptr || !station->equipped) return;
  if (level_ != V2xLevel::kIdeal) {
    station->inbox.ForEach(oldest_, [&](const Inbox::Entry& entry) { visit(AsReceived(entry)); });
    return;
  }
  for (const Station& other : stations_) {
    if (other.id != receiver && other.id != kNone && other.latest.sender != kNone &&
        other.latest.sent >= oldest_)
      visit(AsReceived(other.latest));
  }
}

}  // namespace lanewise
