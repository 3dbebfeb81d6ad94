#include "agents/v2x/channel.h"

#include <omp.h>

#include <algorithm>
#include <cmath>
#include <span>

#include "agents/core/geometry.h"
#include "agents/v2x/radio.h"

namespace lanewise {
namespace {

/// Below this many stations a step runs on one thread.
constexpr std::size_t kMinParallelStations = 64;
/// CAMs sent for want of change after which T_GenCam goes back to its maximum: N_GenCam, default and maximum
/// (EN 302 637-2 V1.4.1, 6.1.3).
constexpr std::int32_t kMaxUnchangedCams = 3;
/// [s] over which the busy share of the channel is measured (ETSI TS 102 687 V1.2.1).
constexpr double kBusyWindow = 0.1;
constexpr double kTimeTolerance = 1e-9;  // [s]
constexpr double kCellSize = 100.0;      // [m]
constexpr std::size_t kChunk = 64;       // Receivers that one thread serves in a row.

}  // namespace

Channel::Channel(const RoadNetwork& network, const V2xParams& params)
    : network_(network),
      params_(params),
      reception_(params, false),
      grid_(kCellSize),
      receiver_grid_(kCellSize),
      scratch_(static_cast<std::size_t>(omp_get_max_threads())) {}

void Channel::Open(V2xLevel level, std::uint64_t seed) {
  level_ = level;
  seed_ = seed;
  reception_ = Reception(params_, level == V2xLevel::kLoaded);
}

StationId Channel::AddRoadsideUnit(double x, double y, std::string_view name) {
  const StationId id = RoadsideStation(static_cast<std::int32_t>(roadside_slot_.size()));
  const std::size_t slot = Enroll(id, HashText(name));
  roadside_slot_.push_back(slot);
  Station& station = stations_[slot];
  station.equipped = station.on_air = true;
  station.x = x;
  station.y = y;
  return id;
}

void Channel::Post(StationId unit, std::uint64_t payload, double bytes) {
  posted_.push_back({unit, payload, bytes});
}

void Channel::Exchange(double dt, const Traffic& traffic) {
  if (!open()) return;
  ++step_;
  dt_ = dt;
  const auto memory = static_cast<std::int32_t>(std::floor(params_.memory / dt + kTimeTolerance));
  oldest_ = step_ - memory;
  log_.resize(static_cast<std::size_t>(memory) + 1);
  counts_.age_histogram.resize(log_.size());
  // The team may have grown since.
  if (scratch_.size() < static_cast<std::size_t>(omp_get_max_threads()))
    scratch_.resize(static_cast<std::size_t>(omp_get_max_threads()));
  for (Scratch& scratch : scratch_) scratch.ages.resize(log_.size() + 1);
  reception_.SetStep(dt);
  EnrollVehicles(traffic);
  NoteFollowers(traffic);
  Generate(dt, traffic);
  if (level_ != V2xLevel::kIdeal) {
    SortSenders();
    const std::span<const AgentIndex> order = receiver_grid_.items();
    const auto station = [&](std::size_t k) { return &stations_[receiver_[order[k]]]; };
#pragma omp parallel for schedule(dynamic, kChunk) if (stations_.size() >= kMinParallelStations)
    for (std::size_t k = 0; k < order.size(); ++k) {
      // Inboxes lie cold from one step to the next: fetched while others are served. Not those of the next
      // chunk, which another thread may write to.
      if (k + 2 < order.size()) __builtin_prefetch(station(k + 2));
      if ((k + 1) % kChunk != 0 && k + 1 < order.size()) station(k + 1)->inbox.Prefetch();
      Receive(dt, station(k), &scratch_[static_cast<std::size_t>(omp_get_thread_num())]);
    }
  }
  Gather();
}

std::size_t Channel::Enroll(StationId id, std::uint64_t key) {
  std::size_t slot = stations_.size();
  if (free_.empty()) {
    stations_.emplace_back();
  } else {
    slot = free_.back();
    free_.pop_back();
  }
  Station& station = stations_[slot];
  station.id = id;
  station.key = key;
  station.busy = 0.0;
  station.follows = kNone;
  station.followed = -1;
  station.cam = {};
  station.cam.t_gen_cam = params_.cam_max_interval;
  station.inbox.Clear();
  station.due.clear();
  station.latest = {};
  return slot;
}

void Channel::EnrollVehicles(const Traffic& traffic) {
  for (std::size_t row = 0; row < traffic.vehicle_count; ++row) {
    const auto number = static_cast<std::size_t>(traffic.number[row]);
    if (number >= vehicle_slot_.size()) vehicle_slot_.resize(number + 1, kNone);
    if (vehicle_slot_[number] == kNone) {
      const std::uint64_t key = traffic.id_hash[row];
      const std::size_t slot = Enroll(traffic.number[row], key);
      vehicle_slot_[number] = static_cast<std::int32_t>(slot);
      // A higher share contains the vehicles of a lower one.
      stations_[slot].equipped =
          RandomStream(seed_, key, RandomPurpose::kRadioShare, 0).Uniform(0) < params_.share;
    }
    Station& station = stations_[static_cast<std::size_t>(vehicle_slot_[number])];
    station.seen = step_;
    station.on_air = station.equipped && traffic.now.lane[row] != kNone;
    if (!station.on_air) Delay(&station);
    station.x = traffic.now.x[row];
    station.y = traffic.now.y[row];
  }
  on_air_ = 0;
  for (std::size_t slot = 0; slot < stations_.size(); ++slot) {
    Station& station = stations_[slot];
    if (station.id >= 0 && station.seen != step_) {
      vehicle_slot_[static_cast<std::size_t>(station.id)] = kNone;
      station.id = kNone;
      station.equipped = station.on_air = false;
      free_.push_back(slot);
    }
    on_air_ += station.on_air;
  }
}

void Channel::Delay(Station* station) {
  for (const std::uint32_t slot : station->due) {
    const Sender& sender = slot_sender_[slot];
    station->inbox.Send({sender.id, step_ - 1, step_, sender.index});
  }
  station->due.clear();
}

bool Channel::MustSend(double dt, const Motion& now, std::size_t row, bool in_platoon, CamState* cam) const {
  if (cam->last_step < 0) return true;
  const double elapsed = (step_ - cam->last_step) * dt + kTimeTolerance;
  if (elapsed < params_.cam_min_interval) return false;
  if (in_platoon) return true;
  const bool changed = std::abs(WrapAngle(now.heading[row] - cam->heading)) > params_.cam_heading ||
                       std::hypot(now.x[row] - cam->x, now.y[row] - cam->y) > params_.cam_position ||
                       std::abs(now.speed[row] - cam->speed) > params_.cam_speed;
  if (changed) {
    cam->t_gen_cam = std::min(elapsed, params_.cam_max_interval);
    cam->n_gen_cam = 0;
    return true;
  }
  if (elapsed < cam->t_gen_cam) return false;
  if (++cam->n_gen_cam >= kMaxUnchangedCams) cam->t_gen_cam = params_.cam_max_interval;
  return true;
}

Message Channel::Describe(const Traffic& traffic, std::size_t row, std::uint64_t key) const {
  const Motion& now = traffic.now;
  const VehicleParams& vehicle = traffic.params[row];
  Message m;
  m.vehicle_class = traffic.vehicle_class[row];
  m.x = now.x[row];
  m.y = now.y[row];
  if (level_ >= V2xLevel::kLossy && params_.position_noise > 0.0) {
    const RandomStream noise(seed_, key, RandomPurpose::kRadioPosition, static_cast<std::uint64_t>(step_));
    m.x += params_.position_noise * noise.Normal(0, 4.0);
    m.y += params_.position_noise * noise.Normal(1, 4.0);
  }
  m.heading = now.heading[row];
  m.speed = static_cast<float>(now.speed[row]);
  m.accel = static_cast<float>(now.accel[row]);
  m.length = static_cast<float>(vehicle.length);
  m.width = static_cast<float>(vehicle.width);
  m.max_decel = static_cast<float>(vehicle.max_decel);
  m.lane = now.lane[row];
  m.wanted_speed = static_cast<float>(traffic.speed_limit[row]);
  m.lane_change = now.blinker[row];
  m.planned_accel = static_cast<float>(now.planned_accel[row]);
  m.planned_jerk = static_cast<float>(now.planned_jerk[row]);
  m.follows = traffic.driven[row] ? now.follows[row] : kNone;
  const Lane& lane = network_.lanes[m.lane];
  const RoutePlan* plan = traffic.plan[row];
  const auto position = static_cast<std::size_t>(traffic.route_position[row]);
  if (plan != nullptr && !lane.internal && position < plan->route().size() &&
      plan->route()[position] == lane.edge) {
    m.next_link = plan->At(position, lane.index).connection;
    m.link_distance = static_cast<float>(lane.length - now.s[row]);
  }
  return m;
}

void Channel::Send(Station* station, const Message& message, double bytes) {
  std::vector<Message>& sent = log_[static_cast<std::size_t>(step_) % log_.size()];
  const Inbox::Entry entry{station->id, step_, step_, static_cast<std::int32_t>(sent.size())};
  sent.push_back(message);
  sent.back().sender = station->id;
  sent.back().step = step_;
  if (level_ == V2xLevel::kIdeal) {
    if (station->latest.sender != kNone && station->latest.sent >= oldest_)
      CountAges(station->latest, on_air_ - 1, &scratch_[0]);
    counts_.fates[static_cast<std::size_t>(Fate::kDelivered)] += on_air_ - 1;
    station->latest = entry;
    return;
  }
  senders_.push_back(
      {RandomStream(seed_, station->key, RandomPurpose::kRadioDelivery, static_cast<std::uint64_t>(step_)),
       station->id, entry.index});
  sender_airtime_.push_back(Airtime(bytes, params_.bitrate));
  sender_x_.push_back(station->x);
  sender_y_.push_back(station->y);
}

void Channel::NoteFollowers(const Traffic& traffic) {
  for (std::size_t row = 0; row < traffic.vehicle_count; ++row) {
    const StationId leader = traffic.driven[row] ? traffic.now.follows[row] : kNone;
    Station& own =
        stations_[static_cast<std::size_t>(vehicle_slot_[static_cast<std::size_t>(traffic.number[row])])];
    if (leader != own.follows) {
      counts_.platoon_joins += leader != kNone;
      counts_.platoon_leaves += own.follows != kNone;
      own.follows = leader;
    }
    // It may have left meanwhile.
    if (leader == kNone || Find(leader) == nullptr) continue;
    ++counts_.cruise_steps;
    const auto heard = LastFrom(leader, traffic.number[row]);
    if (heard && heard->message->follows == leader)
      stations_[static_cast<std::size_t>(vehicle_slot_[static_cast<std::size_t>(leader)])].followed = step_;
  }
}

void Channel::Generate(double dt, const Traffic& traffic) {
  std::vector<Message>& messages = log_[static_cast<std::size_t>(step_) % log_.size()];
  messages.clear();
  messages.reserve(stations_.size());
  senders_.clear();
  sender_x_.clear();
  sender_y_.clear();
  sender_airtime_.clear();
  for (std::size_t row = 0; row < traffic.vehicle_count; ++row) {
    Station& station =
        stations_[static_cast<std::size_t>(vehicle_slot_[static_cast<std::size_t>(traffic.number[row])])];
    if (!station.on_air) continue;
    const bool in_platoon = station.follows != kNone || station.followed == step_;
    if (!MustSend(dt, traffic.now, row, in_platoon, &station.cam)) continue;
    station.cam.last_step = step_;
    station.cam.x = station.x;
    station.cam.y = station.y;
    station.cam.heading = traffic.now.heading[row];
    station.cam.speed = traffic.now.speed[row];
    Send(&station, Describe(traffic, row, station.key), params_.message_bytes);
  }
  for (const Posted& posted : posted_) {
    Message message;
    message.payload = posted.payload;
    Station& unit = stations_[roadside_slot_[static_cast<std::size_t>(RoadsideStation(posted.unit))]];
    message.x = unit.x;
    message.y = unit.y;
    Send(&unit, message, posted.bytes);
  }
  posted_.clear();
}

void Channel::SortSenders() {
  slot_sender_.swap(last_slot_sender_);
  grid_.Build(sender_x_, sender_y_);
  const std::span<const AgentIndex> items = grid_.items();
  slot_sender_.resize(items.size());
  slot_x_.resize(items.size());
  slot_y_.resize(items.size());
  slot_airtime_.resize(items.size());
  for (std::size_t k = 0; k < items.size(); ++k) {
    slot_sender_[k] = senders_[items[k]];
    slot_x_[k] = sender_x_[items[k]];
    slot_y_[k] = sender_y_[items[k]];
    slot_airtime_[k] = sender_airtime_[items[k]];
  }
  receiver_.clear();
  receiver_x_.clear();
  receiver_y_.clear();
  for (std::size_t k = 0; k < stations_.size(); ++k) {
    if (!stations_[k].on_air) continue;
    receiver_.push_back(k);
    receiver_x_.push_back(stations_[k].x);
    receiver_y_.push_back(stations_[k].y);
  }
  receiver_grid_.Build(receiver_x_, receiver_y_);
}

void Channel::Receive(double dt, Station* receiver, Scratch* scratch) {
  const bool loaded = level_ == V2xLevel::kLoaded;
  std::vector<std::uint32_t>& near = scratch->near;
  std::vector<double>& near2 = scratch->near2;
  const std::size_t sensed = grid_.SlotsWithin(
      receiver->x, receiver->y, loaded ? params_.carrier_sense_range : params_.range,
      [xs = slot_x_.data(), ys = slot_y_.data(), x = receiver->x, y = receiver->y](std::uint32_t slot) {
        const double dx = xs[slot] - x, dy = ys[slot] - y;
        return dx * dx + dy * dy;
      },
      &near, &near2);
  if (loaded) {
    double airtime = 0.0;
    for (std::size_t k = 0; k < sensed; ++k) airtime += slot_airtime_[near[k]];
    const double share = std::min(1.0, dt / kBusyWindow);
    receiver->busy += share * (std::min(1.0, airtime / dt) - receiver->busy);
  }
  const double range2 = params_.range * params_.range;
  std::size_t count = 0;
  for (std::size_t k = 0; k < sensed; ++k) {
    const std::uint32_t slot = near[k];
    const double distance2 = near2[k];
    near[count] = slot;
    near2[count] = distance2;
    count += static_cast<std::size_t>(distance2 <= range2) &
             static_cast<std::size_t>(slot_sender_[slot].id != receiver->id);
  }
  for (const std::uint32_t slot : receiver->due) {
    const Sender& sender = last_slot_sender_[slot];
    Keep({sender.id, step_ - 1, step_, sender.index}, receiver, scratch);
  }
  receiver->due.clear();
  receiver->inbox.Arrive(step_, [&](const Inbox::Entry& entry) { Keep(entry, receiver, scratch); });
  if (level_ != V2xLevel::kRange) return Deliver(count, receiver, scratch);
  scratch->fates[static_cast<std::size_t>(Fate::kDelivered)] += static_cast<std::int64_t>(count);
  for (std::size_t k = 0; k < count; ++k) {
    const Sender& sender = slot_sender_[near[k]];
    Keep({sender.id, step_, step_, sender.index}, receiver, scratch);
  }
}

void Channel::Deliver(std::size_t count, Station* receiver, Scratch* scratch) const {
  const double load = receiver->busy;
  const std::uint64_t key = receiver->key;
  const Reception::Bounds* bounds = reception_.AtLoad(load);
  if (receiver->due.capacity() < count) receiver->due.reserve(2 * count);  // A warm step does not allocate.
  receiver->due.resize(count);
  std::uint32_t* due = receiver->due.data();
  for (std::size_t k = 0; k < count; ++k) {
    const std::uint32_t slot = scratch->near[k];
    const std::uint64_t bits = slot_sender_[slot].draws.Bits(key);
    const auto latency_draw = static_cast<std::uint32_t>(bits);
    const Fate fate =
        reception_.FateOf(bounds, load, scratch->near2[k], static_cast<std::uint32_t>(bits >> 32));
    ++scratch->fates[static_cast<std::size_t>(fate)];
    const bool delivered = fate == Fate::kDelivered, next_step = reception_.IsThereNextStep(latency_draw);
    *due = slot;
    due += static_cast<int>(delivered) & static_cast<int>(next_step);
    if (delivered & !next_step) [[unlikely]] {
      const Sender& sender = slot_sender_[slot];
      const std::int32_t latency = reception_.Latency(latency_draw);
      const Inbox::Entry entry{sender.id, step_, step_ + latency, sender.index};
      if (latency > 0) {
        receiver->inbox.Send(entry);
      } else {
        Keep(entry, receiver, scratch);
      }
    }
  }
  receiver->due.resize(static_cast<std::size_t>(due - receiver->due.data()));
}

void Channel::Keep(const Inbox::Entry& entry, Station* receiver, Scratch* scratch) const {
  const Inbox::Entry before = receiver->inbox.Put(entry, oldest_);
  if (before.sender != kNone && before.sent < entry.sent) CountAges(before, 1, scratch);
}

void Channel::CountAges(const Inbox::Entry& before, std::int64_t pairs, Scratch* scratch) const {
  scratch->ages[static_cast<std::size_t>(before.received - before.sent)] += pairs;
  scratch->ages[static_cast<std::size_t>(step_ - before.sent)] -= pairs;
}

void Channel::Gather() {
  counts_.station_steps += on_air_;
  counts_.sent += static_cast<std::int64_t>(log_[static_cast<std::size_t>(step_) % log_.size()].size());
  for (Scratch& scratch : scratch_) {
    for (std::size_t k = 0; k < kFates; ++k) counts_.fates[k] += scratch.fates[k];
    std::int64_t pairs = 0;
    for (std::size_t age = 0; age < log_.size(); ++age) {
      pairs += scratch.ages[age];
      counts_.age_histogram[age] += pairs;
      counts_.age_count += pairs;
      counts_.age_steps += pairs * static_cast<std::int64_t>(age);
    }
    scratch.fates = {};
    std::fill(scratch.ages.begin(), scratch.ages.end(), 0);
  }
  if (level_ != V2xLevel::kLoaded) return;
  counts_.step_busy_max = 0.0;
  for (const Station& station : stations_) {  // In order of slots, so that the sum is the same for any team.
    if (!station.on_air) continue;
    counts_.busy_sum += station.busy;
    counts_.step_busy_max = std::max(counts_.step_busy_max, station.busy);
  }
}

const Channel::Station* Channel::Find(StationId station) const {
  if (IsRoadside(station)) {
    const auto unit = static_cast<std::size_t>(RoadsideStation(station));
    return unit < roadside_slot_.size() ? &stations_[roadside_slot_[unit]] : nullptr;
  }
  const auto number = static_cast<std::size_t>(station);
  if (station < 0 || number >= vehicle_slot_.size() || vehicle_slot_[number] == kNone) return nullptr;
  return &stations_[static_cast<std::size_t>(vehicle_slot_[number])];
}

std::optional<Received> Channel::LastFrom(StationId receiver, StationId sender) const {
  const Station* station = Find(receiver);
  if (station == nullptr || !station->equipped || receiver == sender) return std::nullopt;
  if (level_ != V2xLevel::kIdeal) {
    const auto entry = station->inbox.Find(sender, oldest_);
    return entry ? std::optional(AsReceived(*entry)) : std::nullopt;
  }
  const Station* other = Find(sender);
  if (other == nullptr || other->latest.sender == kNone || other->latest.sent < oldest_) return std::nullopt;
  return AsReceived(other->latest);
}

bool Channel::IsEquipped(StationId station) const {
  const Station* found = Find(station);
  return found != nullptr && found->equipped;
}

double Channel::BusyRatio(StationId station) const {
  const Station* found = Find(station);
  return found == nullptr ? 0.0 : found->busy;
}

}  // namespace lanewise
