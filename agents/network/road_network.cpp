#include "agents/network/road_network.h"

#include <fmt/core.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <memory>
#include <pugixml.hpp>
#include <system_error>
#include <utility>

#include "agents/core/check.h"

namespace lanewise {
namespace {

/// SUMO's vehicle classes; the position is the bit in a VehicleClassMask.
constexpr std::array<std::string_view, 33> kVehicleClassNames{
    "private",    "emergency", "authority",     "army",      "vip",       "pedestrian", "passenger",
    "hov",        "taxi",      "bus",           "coach",     "delivery",  "truck",      "trailer",
    "motorcycle", "moped",     "bicycle",       "evehicle",  "tram",      "rail_urban", "rail",
    "rail_fast",  "ship",      "rail_electric", "container", "cable_car", "subway",     "aircraft",
    "wheelchair", "scooter",   "drone",         "custom1",   "custom2"};
static_assert(kVehicleClassNames.size() < 64, "one bit of a VehicleClassMask each");

constexpr std::string_view kBlanks = " \t\r\n";

/// Calls `visit` with every word of a blank-separated list.
template <class Visitor>
void ForEachWord(std::string_view text, Visitor&& visit) {
  for (auto begin = text.find_first_not_of(kBlanks); begin != std::string_view::npos;) {
    const auto end = std::min(text.find_first_of(kBlanks, begin), text.size());
    visit(text.substr(begin, end - begin));
    begin = text.find_first_not_of(kBlanks, end);
  }
}

/// Classes named in an allow or disallow list. Names of a newer SUMO are unknown and match no vehicle of
/// ours.
VehicleClassMask ParseVehicleClasses(std::string_view names) {
  VehicleClassMask mask = 0;
  ForEachWord(names, [&mask](std::string_view name) {
    mask |= name == "all" ? kAllVehicleClasses : VehicleClassBit(name);
  });
  return mask;
}

VehicleClassMask ParsePermissions(std::string_view allow, std::string_view disallow) {
  if (!allow.empty()) return ParseVehicleClasses(allow);
  return ~ParseVehicleClasses(disallow);
}

template <class Number>
bool ParseNumber(std::string_view text, Number* value) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), *value);
  return error == std::errc{} && end == text.data() + text.size();
}

/// Bits of a request string: they read right to left, so link 0 is the last character.
std::vector<bool> ParseBits(std::string_view bits) {
  std::vector<bool> result(bits.size());
  std::transform(bits.rbegin(), bits.rend(), result.begin(), [](char bit) { return bit == '1'; });
  return result;
}

EdgeFunction ParseFunction(std::string_view name) {
  if (name == "internal") return EdgeFunction::kInternal;
  if (name == "crossing") return EdgeFunction::kCrossing;
  if (name == "walkingarea") return EdgeFunction::kWalkingArea;
  if (name == "connector") return EdgeFunction::kConnector;
  return EdgeFunction::kNormal;
}

/// Whole content of a file; zlib inflates gzip and passes everything else through.
std::string ReadFile(const std::filesystem::path& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) {
    throw ConfigError(fmt::format("{}: no such file", path.string()));
  }
  const std::unique_ptr<gzFile_s, int (*)(gzFile)> file(gzopen(path.c_str(), "rb"), &gzclose);
  if (!file) throw ConfigError(fmt::format("{}: cannot be opened", path.string()));
  std::string content;
  std::vector<char> buffer(std::size_t{1} << 18);
  int count = 0;
  while ((count = gzread(file.get(), buffer.data(), static_cast<unsigned>(buffer.size()))) > 0) {
    content.append(buffer.data(), static_cast<std::size_t>(count));
  }
  int status = Z_OK;
  const std::string message = gzerror(file.get(), &status);
  if (count < 0 || (status != Z_OK && status != Z_STREAM_END)) {
    throw ConfigError(fmt::format("{}: cannot be read: {}", path.string(), message));
  }
  return content;
}

/// Fills the tables of one network. Elements refer to others by id, so edges come first, then junctions, then
/// connections, whatever their order in the file.
class NetFileReader {
 public:
  explicit NetFileReader(const std::filesystem::path& path)
      : file_(path.string()), content_(ReadFile(path)) {}

  RoadNetwork Read() {
    const pugi::xml_parse_result parsed = document_.load_buffer(content_.data(), content_.size());
    if (!parsed) {
      throw ConfigError(
          fmt::format("{}:{}: broken XML: {}", file_, LineOf(parsed.offset), parsed.description()));
    }
    const pugi::xml_node root = document_.document_element();
    if (std::string_view(root.name()) != "net") {
      throw ConfigError(fmt::format("{}: not a SUMO net file: the root element is <{}>, expected <net>",
                                    file_, root.name()));
    }
    network_.left_hand = root.attribute("lefthand").as_bool();
    for (const pugi::xml_node edge : root.children("edge")) ReadEdge(edge);
    for (const pugi::xml_node junction : root.children("junction")) ReadJunction(junction);
    for (const pugi::xml_node edge : root.children("edge")) ResolveEnds(edge);
    for (const pugi::xml_node connection : root.children("connection")) ReadConnection(connection);
    for (std::size_t j = 0; j < network_.junctions.size(); ++j) NumberLinks(static_cast<std::int32_t>(j));
    return std::move(network_);
  }

 private:
  std::ptrdiff_t LineOf(std::ptrdiff_t offset) const {
    const auto end = content_.begin() + std::min<std::ptrdiff_t>(offset, std::ssize(content_));
    return 1 + std::count(content_.begin(), end, '\n');
  }

  [[noreturn]] void Fail(const pugi::xml_node& element, std::string_view problem) const {
    std::string name = element.name();
    for (const char* key : {"id", "from", "to", "index"}) {
      if (const auto attribute = element.attribute(key)) {
        name += fmt::format(" {}=\"{}\"", key, attribute.value());
      }
    }
    throw ConfigError(fmt::format("{}:{}: <{}>: {}", file_, LineOf(element.offset_debug()), name, problem));
  }

  std::string Text(const pugi::xml_node& element, const char* name) const {
    const auto attribute = element.attribute(name);
    if (!attribute) Fail(element, fmt::format("attribute \"{}\" is missing", name));
    return attribute.value();
  }

  template <class Number>
  Number Value(const pugi::xml_node& element, const char* name) const {
    const std::string text = Text(element, name);
    Number value{};
    if (!ParseNumber(text, &value)) {
      Fail(element, fmt::format("attribute \"{}\" is \"{}\", expected a number", name, text));
    }
    return value;
  }

  template <class Number>
  Number ValueOr(const pugi::xml_node& element, const char* name, Number fallback) const {
    return element.attribute(name) ? Value<Number>(element, name) : fallback;
  }

  double Magnitude(const pugi::xml_node& element, const char* name) const {
    const double value = Value<double>(element, name);
    if (!(value >= 0.0)) Fail(element, fmt::format("attribute \"{}\" is {}, expected >= 0", name, value));
    return value;
  }

  void ReadEdge(const pugi::xml_node& element) {
    Edge edge;
    edge.id = Text(element, "id");
    edge.function = ParseFunction(element.attribute("function").value());
    edge.first_lane = static_cast<LaneIndex>(network_.lanes.size());
    const auto index = static_cast<EdgeIndex>(network_.edges.size());
    for (const pugi::xml_node lane : element.children("lane")) {
      ReadLane(lane, index, edge.function, edge.lane_count++);
    }
    if (edge.lane_count == 0) Fail(element, "has no lane");
    if (!network_.edge_by_id.emplace(edge.id, index).second) Fail(element, "is defined twice");
    network_.edges.push_back(std::move(edge));
  }

  void ReadLane(const pugi::xml_node& element, EdgeIndex edge, EdgeFunction function, std::int32_t position) {
    Lane lane;
    lane.id = Text(element, "id");
    lane.edge = edge;
    lane.index = position;  // Not the attribute: netconvert writes index 0 for every lane of a waiting edge.
    lane.internal = function == EdgeFunction::kInternal;
    lane.length = Magnitude(element, "length");
    if (element.attribute("speed")) lane.speed_limit = Magnitude(element, "speed");
    if (element.attribute("width")) lane.width = Magnitude(element, "width");
    lane.allowed =
        ParsePermissions(element.attribute("allow").value(), element.attribute("disallow").value());
    lane.shape = ReadShape(element);
    const auto index = static_cast<LaneIndex>(network_.lanes.size());
    if (!network_.lane_by_id.emplace(lane.id, index).second) Fail(element, "is defined twice");
    network_.lanes.push_back(std::move(lane));
  }

  /// Points "x,y" or "x,y,z"; heights are dropped.
  std::vector<Point2> ReadShape(const pugi::xml_node& element) const {
    std::vector<Point2> shape;
    ForEachWord(element.attribute("shape").value(), [&](std::string_view word) {
      const auto comma = word.find(',');
      const auto rest = comma == std::string_view::npos ? std::string_view{} : word.substr(comma + 1);
      Point2 point;
      if (!ParseNumber(word.substr(0, comma), &point.x) ||
          !ParseNumber(rest.substr(0, rest.find(',')), &point.y)) {
        Fail(element, fmt::format("attribute \"shape\" has the point \"{}\", expected \"x,y\"", word));
      }
      shape.push_back(point);
    });
    return shape;
  }

  LaneIndex LaneNamed(const pugi::xml_node& element, const char* attribute, const std::string& id) const {
    const LaneIndex lane = network_.FindLane(id);
    if (lane == kNone)
      Fail(element, fmt::format("attribute \"{}\" names the unknown lane \"{}\"", attribute, id));
    return lane;
  }

  std::vector<LaneIndex> LanesNamed(const pugi::xml_node& element, const char* attribute) const {
    std::vector<LaneIndex> lanes;
    ForEachWord(element.attribute(attribute).value(), [&](std::string_view id) {
      lanes.push_back(LaneNamed(element, attribute, std::string(id)));
    });
    return lanes;
  }

  void ReadJunction(const pugi::xml_node& element) {
    Junction junction;
    junction.id = Text(element, "id");
    junction.type = element.attribute("type").value();
    junction.incoming = LanesNamed(element, "incLanes");
    junction.internal = LanesNamed(element, "intLanes");
    for (const pugi::xml_node request : element.children("request")) ReadRequest(request, &junction.requests);
    const auto index = static_cast<std::int32_t>(network_.junctions.size());
    if (!junction_by_id_.emplace(junction.id, index).second) Fail(element, "is defined twice");
    // An internal junction (where left turners wait) lists the lanes of its foes too; they belong to the
    // outer one.
    if (junction.type != "internal") {
      for (const LaneIndex lane : junction.internal) {
        Edge& edge = network_.edges[network_.lanes[lane].edge];
        edge.from_junction = edge.to_junction = index;
      }
    }
    network_.junctions.push_back(std::move(junction));
  }

  void ReadRequest(const pugi::xml_node& element, std::vector<RightOfWay>* requests) const {
    const auto index = Value<std::int32_t>(element, "index");
    if (index != std::ssize(*requests)) {
      Fail(element, fmt::format("attribute \"index\", expected {}", requests->size()));
    }
    requests->push_back({.response = ParseBits(Text(element, "response")),
                         .foes = ParseBits(Text(element, "foes")),
                         .cont = element.attribute("cont").as_bool()});
  }

  std::int32_t JunctionNamed(const pugi::xml_node& element, const char* attribute) const {
    const std::string id = Text(element, attribute);
    const auto found = junction_by_id_.find(id);
    if (found == junction_by_id_.end()) {
      Fail(element, fmt::format("attribute \"{}\" names the unknown junction \"{}\"", attribute, id));
    }
    return found->second;
  }

  void ResolveEnds(const pugi::xml_node& element) {
    Edge& edge = network_.edges[network_.FindEdge(element.attribute("id").value())];
    if (element.attribute("from")) edge.from_junction = JunctionNamed(element, "from");
    if (element.attribute("to")) edge.to_junction = JunctionNamed(element, "to");
  }

  LaneIndex ConnectedLane(const pugi::xml_node& element, const char* edge_key, const char* lane_key) const {
    const std::string id = Text(element, edge_key);
    const EdgeIndex edge = network_.FindEdge(id);
    if (edge == kNone)
      Fail(element, fmt::format("attribute \"{}\" names the unknown edge \"{}\"", edge_key, id));
    const auto lane = Value<std::int32_t>(element, lane_key);
    const std::int32_t count = network_.edges[edge].lane_count;
    if (lane < 0 || lane >= count) {
      Fail(element, fmt::format("attribute \"{}\" is {}, but edge \"{}\" has the lanes 0 to {}", lane_key,
                                lane, id, count - 1));
    }
    return network_.edges[edge].first_lane + lane;
  }

  void ReadConnection(const pugi::xml_node& element) {
    Connection connection;
    connection.from = ConnectedLane(element, "from", "fromLane");
    connection.to = ConnectedLane(element, "to", "toLane");
    if (element.attribute("via")) connection.via = LaneNamed(element, "via", Text(element, "via"));
    connection.direction = FirstCharacter(element, "dir", connection.direction);
    connection.state = FirstCharacter(element, "state", connection.state);
    connection.keep_clear = element.attribute("keepClear").as_bool(true);
    if (element.attribute("tl")) {
      connection.signal = SignalNamed(Text(element, "tl"));
      connection.link_index = Value<std::int32_t>(element, "linkIndex");
    }
    connection.junction = network_.edges[network_.lanes[connection.from].edge].to_junction;
    const auto index = static_cast<std::int32_t>(network_.connections.size());
    network_.lanes[connection.from].outgoing.push_back(index);
    network_.lanes[connection.to].incoming.push_back(index);
    if (connection.via != kNone) network_.lanes[connection.via].incoming.push_back(index);
    network_.connections.push_back(connection);
  }

  static char FirstCharacter(const pugi::xml_node& element, const char* name, char fallback) {
    const std::string_view text = element.attribute(name).value();
    return text.empty() ? fallback : text.front();
  }

  std::int32_t SignalNamed(const std::string& id) {
    const auto [entry, is_new] =
        signal_by_id_.emplace(id, static_cast<std::int32_t>(network_.signal_ids.size()));
    if (is_new) network_.signal_ids.push_back(id);
    return entry->second;
  }

  EdgeFunction FunctionOf(LaneIndex lane) const { return network_.edges[network_.lanes[lane].edge].function; }

  /// Of the connections for pedestrians only those onto a crossing are links.
  bool IsLink(const Connection& connection) const {
    if (FunctionOf(connection.to) == EdgeFunction::kWalkingArea) return false;
    return FunctionOf(connection.from) != EdgeFunction::kWalkingArea ||
           FunctionOf(connection.to) == EdgeFunction::kCrossing;
  }

  /// Gives the links of a junction their rows in the right-of-way matrix: in the order of the incoming lanes
  /// and, for each, of its connections.
  void NumberLinks(std::int32_t index) {
    const Junction& junction = network_.junctions[index];
    if (junction.type == "internal") return;
    std::int32_t row = 0;
    for (const LaneIndex lane : junction.incoming) {
      for (const std::int32_t id : network_.lanes[lane].outgoing) {
        Connection& connection = network_.connections[id];
        if (!IsLink(connection)) continue;
        if (row < std::ssize(junction.requests)) connection.request = row;
        connection.junction = index;
        ++row;
      }
    }
  }

  std::string file_;
  std::string content_;
  pugi::xml_document document_;
  RoadNetwork network_;
  std::unordered_map<std::string, std::int32_t> junction_by_id_;
  std::unordered_map<std::string, std::int32_t> signal_by_id_;
};

}  // namespace

VehicleClassMask VehicleClassBit(std::string_view name) {
  if (name == "ignoring") return kAllVehicleClasses;
  const auto found = std::find(kVehicleClassNames.begin(), kVehicleClassNames.end(), name);
  if (found == kVehicleClassNames.end()) return 0;
  return VehicleClassMask{1} << static_cast<unsigned>(found - kVehicleClassNames.begin());
}

LaneIndex RoadNetwork::FindLane(const std::string& id) const {
  const auto found = lane_by_id.find(id);
  return found == lane_by_id.end() ? kNone : found->second;
}

EdgeIndex RoadNetwork::FindEdge(const std::string& id) const {
  const auto found = edge_by_id.find(id);
  return found == edge_by_id.end() ? kNone : found->second;
}

LaneIndex RoadNetwork::Neighbor(LaneIndex lane, int side) const {
  const Edge& edge = edges[lanes[lane].edge];
  const LaneIndex neighbor = lane + side;
  const bool exists = neighbor >= edge.first_lane && neighbor < edge.first_lane + edge.lane_count;
  return exists ? neighbor : kNone;
}

RoadNetwork LoadRoadNetwork(const std::filesystem::path& file) {
  return NetFileReader(file).Read();
}

}  // namespace lanewise
