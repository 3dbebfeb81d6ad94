#include "analysis/following_data.h"

#include <expat.h>
#include <fmt/core.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstring>
#include <exception>
#include <limits>
#include <memory>
#include <optional>
#include <string_view>
#include <unordered_map>

#include "agents/core/check.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

/// A file of text, gzipped or not, in pieces.
class InputFile {
 public:
  explicit InputFile(const fs::path& path) : path_(path) {
    std::error_code error;
    if (!fs::is_regular_file(path, error)) throw ConfigError(fmt::format("{}: no such file", path.string()));
    size_ = static_cast<double>(fs::file_size(path, error));
    file_.reset(gzopen(path.c_str(), "rb"));
    if (!file_) throw ConfigError(fmt::format("{}: cannot be opened", path.string()));
    gzbuffer(file_.get(), 1 << 18);
  }

  /// The next piece; empty at the end.
  std::string_view Read() {
    const int count = gzread(file_.get(), buffer_.data(), static_cast<unsigned>(buffer_.size()));
    int status = Z_OK;
    const char* message = gzerror(file_.get(), &status);
    if (count < 0 || (count == 0 && status != Z_OK && status != Z_STREAM_END))
      throw ConfigError(fmt::format("{}: cannot be read: {}", path_.string(), message));
    return {buffer_.data(), static_cast<std::size_t>(count)};
  }
  double PartRead() const { return size_ > 0.0 ? static_cast<double>(gzoffset(file_.get())) / size_ : 1.0; }

 private:
  struct Close {
    void operator()(gzFile_s* file) const { gzclose(file); }
  };
  fs::path path_;
  double size_{0.0};
  std::unique_ptr<gzFile_s, Close> file_;
  std::vector<char> buffer_ = std::vector<char>(std::size_t{1} << 18);
};

/// One vehicle at one time, as the file has it.
struct Row {
  std::string id, type, lane, leader;
  double time{0.0}, speed{0.0};
  std::optional<double> pos, length, leader_gap, leader_speed;
};

enum class Field { kTime, kId, kType, kSpeed, kLane, kPos, kLength, kLeader, kLeaderGap, kLeaderSpeed };
constexpr std::array<std::pair<std::string_view, Field>, 10> kFields{{{"time", Field::kTime},
                                                                      {"id", Field::kId},
                                                                      {"type", Field::kType},
                                                                      {"speed", Field::kSpeed},
                                                                      {"lane", Field::kLane},
                                                                      {"pos", Field::kPos},
                                                                      {"length", Field::kLength},
                                                                      {"leaderID", Field::kLeader},
                                                                      {"leaderGap", Field::kLeaderGap},
                                                                      {"leaderSpeed", Field::kLeaderSpeed}}};

std::optional<Field> FieldOf(std::string_view name) {
  for (const auto& [text, field] : kFields) {
    if (text == name) return field;
  }
  return std::nullopt;
}

/// Turns rows, in order of time, into episodes. Messages name `origin` and the line given last.
class Collector {
 public:
  Collector(std::string origin, const FollowingOptions& options)
      : origin_(std::move(origin)), options_(options) {}

  void SetLine(std::int64_t line) { line_ = line; }
  [[noreturn]] void Fail(std::string_view problem) const {
    throw ConfigError(fmt::format("{}: line {}: {}", origin_, line_, problem));
  }

  void Begin(double time) {
    if (in_step_ && time == step_time_) return;
    if (in_step_ && time < step_time_)
      Fail(fmt::format("time is {:g} after {:g}; rows must be in order of time", time, step_time_));
    End();
    if (data_.timesteps == 0) data_.begin = time;
    ++data_.timesteps;
    step_time_ = time;
    in_step_ = true;
  }
  /// A field's text into a row.
  void Set(Field field, std::string_view text, Row* row) const {
    switch (field) {
      case Field::kTime:
        row->time = Number("time", text, -1e12, 1e12);
        break;
      case Field::kId:
        row->id = text;
        break;
      case Field::kType:
        row->type = text;
        break;
      case Field::kSpeed:
        row->speed = Number("speed", text, 0.0, 200.0);
        break;
      case Field::kLane:
        row->lane = text;
        break;
      case Field::kPos:
        row->pos = Number("pos", text, -1e7, 1e7);
        break;
      case Field::kLength:
        row->length = Number("length", text, 0.1, 1000.0);
        break;
      case Field::kLeader:
        row->leader = text;
        break;
      case Field::kLeaderGap:
        // SUMO writes the lowest number there is where a leader has no gap.
        row->leader_gap = Number("leaderGap", text, std::numeric_limits<double>::lowest(), 1e7);
        break;
      case Field::kLeaderSpeed:
        row->leader_speed = Number("leaderSpeed", text, -1.0, 200.0);
        break;
    }
  }
  void Add(Row row) {
    if (row.leader_gap && row.leader_speed) data_.leaders_named = true;
    ++data_.rows;
    std::int64_t& last_step = vehicles_[row.id];
    if (last_step == data_.timesteps)
      Fail(fmt::format("vehicle '{}' twice at time {:g}", row.id, step_time_));
    last_step = data_.timesteps;
    rows_.push_back(std::move(row));
  }
  FollowingData Finish() {
    End();
    while (!open_.empty()) Close(open_.begin());
    if (data_.timesteps == 0) throw ConfigError(fmt::format("{}: no timesteps", origin_));
    if (data_.rows == 0) throw ConfigError(fmt::format("{}: no vehicles", origin_));
    if (!data_.leaders_named && !any_place_)
      throw ConfigError(fmt::format(
          "{}: nothing tells who follows whom; needed: lane and pos, or leaderID, leaderGap and leaderSpeed "
          "(sumo --fcd-output.max-leader-distance 100)",
          origin_));
    data_.end = step_time_;
    data_.vehicles = static_cast<std::int64_t>(vehicles_.size());
    return std::move(data_);
  }

 private:
  struct Open {
    FollowingEpisode episode;
    std::int64_t step;
  };
  using OpenMap = std::unordered_map<std::string, Open>;

  double Number(std::string_view name, std::string_view text, double min, double max) const {
    double value = 0.0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc{} || end != text.data() + text.size() || !std::isfinite(value))
      Fail(fmt::format("{} is '{}'; a number is needed", name, text));
    if (value < min || value > max)
      Fail(fmt::format("{} is {:g}; allowed: {:g} to {:g}", name, value, min, max));
    return value;
  }

  double LengthOf(const Row& row) {
    if (row.length) return *row.length;
    if (const auto found = options_.lengths.find(row.type); found != options_.lengths.end())
      return found->second;
    ++data_.unknown_lengths;
    return options_.length;
  }

  /// Who follows whom in the present timestep.
  void End() {
    if (data_.leaders_named) {
      for (const Row& row : rows_) {
        if (!row.leader.empty() && row.leader_gap && row.leader_speed && *row.leader_speed >= 0.0)
          Follow(row, row.leader, *row.leader_gap, *row.leader_speed);
      }
    } else {
      std::vector<const Row*> order;
      for (const Row& row : rows_) {
        if (!row.lane.empty() && row.pos) order.push_back(&row);
      }
      any_place_ = any_place_ || !order.empty();
      std::stable_sort(order.begin(), order.end(), [](const Row* a, const Row* b) {
        return a->lane != b->lane ? a->lane < b->lane : *a->pos > *b->pos;
      });
      for (std::size_t i = 1; i < order.size(); ++i) {
        const Row &leader = *order[i - 1], &row = *order[i];
        if (leader.lane != row.lane) continue;
        Follow(row, leader.id, *leader.pos - LengthOf(leader) - *row.pos, leader.speed);
      }
    }
    for (auto it = open_.begin(); it != open_.end();) {
      const auto next = std::next(it);
      if (it->second.step != data_.timesteps) Close(it);
      it = next;
    }
    rows_.clear();
  }

  void Follow(const Row& row, const std::string& leader, double gap, double leader_speed) {
    auto it = open_.find(row.id);
    if (it != open_.end()) {
      const FollowingEpisode& e = it->second.episode;
      const double dt = step_time_ - e.time.back();
      const double change = 0.5 * dt * (leader_speed + e.leader_speed.back() - row.speed - e.speed.back());
      const bool same = e.leader == leader && dt <= options_.max_interval + 1e-9 && gap > 0.0;
      const bool jumps = same && std::abs(gap - e.gap.back() - change) > options_.max_jump;
      data_.jumps += jumps ? 1 : 0;
      if (!same || jumps || gap > options_.max_gap) {
        Close(it);
        it = open_.end();
      }
    }
    if (!(gap > 0.0) || gap > options_.max_gap) return;
    if (it == open_.end()) {
      it = open_.emplace(row.id, Open{}).first;
      it->second.episode.vehicle = row.id;
      it->second.episode.type = row.type;
      it->second.episode.leader = leader;
    }
    FollowingEpisode& e = it->second.episode;
    e.time.push_back(step_time_);
    e.gap.push_back(gap);
    e.speed.push_back(row.speed);
    e.leader_speed.push_back(leader_speed);
    it->second.step = data_.timesteps;
  }

  void Close(OpenMap::iterator it) {
    FollowingEpisode& e = it->second.episode;
    double distance = 0.0;
    for (std::size_t k = 1; k < e.time.size(); ++k)
      distance += 0.5 * (e.speed[k] + e.speed[k - 1]) * (e.time[k] - e.time[k - 1]);
    const bool kept = e.time.size() >= 3 && e.time.back() - e.time.front() >= options_.min_duration - 1e-9 &&
                      distance >= options_.min_distance;
    if (kept) {
      data_.episodes.push_back(std::move(e));
    } else {
      ++data_.too_short;
    }
    open_.erase(it);
  }

  std::string origin_;
  const FollowingOptions& options_;
  std::int64_t line_{1};
  FollowingData data_;
  bool in_step_{false}, any_place_{false};
  double step_time_{0.0};
  std::vector<Row> rows_;
  std::unordered_map<std::string, std::int64_t> vehicles_;  // Id to its last timestep.
  OpenMap open_;
};

/// Calls `element(name, attributes)` for every start tag of an XML text that comes in pieces. expat is C:
/// exceptions wait until it has returned.
class XmlStream {
 public:
  using Element = std::function<void(const char* name, const char** attributes)>;

  XmlStream(std::string origin, Element element)
      : origin_(std::move(origin)), element_(std::move(element)), parser_(XML_ParserCreate(nullptr)) {
    XML_SetUserData(parser_.get(), this);
    XML_SetStartElementHandler(parser_.get(), [](void* self, const char* name, const char** attributes) {
      auto* stream = static_cast<XmlStream*>(self);
      if (stream->failure_) return;
      try {
        stream->element_(name, attributes);
      } catch (...) {
        stream->failure_ = std::current_exception();
        XML_StopParser(stream->parser_.get(), XML_FALSE);
      }
    });
  }
  void Parse(std::string_view piece, bool is_last) {
    const XML_Status status =
        XML_Parse(parser_.get(), piece.data(), static_cast<int>(piece.size()), is_last ? 1 : 0);
    if (failure_) std::rethrow_exception(failure_);
    if (status != XML_STATUS_ERROR) return;
    throw ConfigError(fmt::format("{}: line {}: no well-formed XML: {}", origin_, line(),
                                  XML_ErrorString(XML_GetErrorCode(parser_.get()))));
  }
  std::int64_t line() const { return static_cast<std::int64_t>(XML_GetCurrentLineNumber(parser_.get())); }

 private:
  struct Free {
    void operator()(XML_ParserStruct* parser) const { XML_ParserFree(parser); }
  };
  std::string origin_;
  Element element_;
  std::unique_ptr<XML_ParserStruct, Free> parser_;
  std::exception_ptr failure_;
};

class FcdReader {
 public:
  FcdReader(const std::string& origin, Collector* collector)
      : collector_(collector),
        stream_(origin, [this](const char* name, const char** attributes) { Element(name, attributes); }) {}
  void Parse(std::string_view piece, bool is_last) { stream_.Parse(piece, is_last); }

 private:
  void Element(const char* name, const char** attributes) {
    collector_->SetLine(stream_.line());
    if (!seen_root_) {
      seen_root_ = true;
      if (std::strcmp(name, "fcd-export") != 0)
        collector_->Fail(fmt::format("the document is <{}>; needed: <fcd-export>, SUMO's fcd output", name));
      return;
    }
    if (std::strcmp(name, "timestep") == 0) {
      Row row;
      if (!Read(attributes, Field::kTime, &row)) collector_->Fail("<timestep> has no attribute time");
      collector_->Begin(row.time);
      in_timestep_ = true;
    } else if (std::strcmp(name, "vehicle") == 0) {
      if (!in_timestep_) collector_->Fail("<vehicle> outside of <timestep>");
      Row row;
      bool has_id = false, has_speed = false;
      for (const char** a = attributes; *a != nullptr; a += 2) {
        const std::optional<Field> field = FieldOf(a[0]);
        if (!field || *field == Field::kTime) continue;
        collector_->Set(*field, a[1], &row);
        has_id = has_id || *field == Field::kId;
        has_speed = has_speed || *field == Field::kSpeed;
      }
      if (!has_id || row.id.empty()) collector_->Fail("<vehicle> has no attribute id");
      if (!has_speed) collector_->Fail(fmt::format("vehicle '{}' has no attribute speed", row.id));
      collector_->Add(std::move(row));
    }
  }
  bool Read(const char** attributes, Field wanted, Row* row) const {
    for (const char** a = attributes; *a != nullptr; a += 2) {
      if (FieldOf(a[0]) != wanted) continue;
      collector_->Set(wanted, a[1], row);
      return true;
    }
    return false;
  }

  Collector* collector_;
  XmlStream stream_;
  bool seen_root_{false}, in_timestep_{false};
};

class CsvReader {
 public:
  explicit CsvReader(Collector* collector) : collector_(collector) {}

  void Parse(std::string_view piece, bool is_last) {
    rest_ += piece;
    std::size_t begin = 0;
    for (std::size_t end = 0; (end = rest_.find('\n', begin)) != std::string::npos; begin = end + 1)
      Line(std::string_view(rest_).substr(begin, end - begin));
    rest_.erase(0, begin);
    if (!is_last) return;
    if (!rest_.empty()) Line(rest_);
    if (columns_.empty()) collector_->Fail("the file is empty; a header line is needed");
  }

 private:
  void Line(std::string_view text) {
    collector_->SetLine(++line_);
    if (!text.empty() && text.back() == '\r') text.remove_suffix(1);
    if (text.empty() || text.front() == '#') return;
    if (columns_.empty()) separator_ = text.find(';') != std::string_view::npos ? ';' : ',';
    values_.clear();
    for (std::size_t begin = 0;;) {
      const std::size_t end = text.find(separator_, begin);
      values_.push_back(text.substr(begin, end == std::string_view::npos ? end : end - begin));
      if (end == std::string_view::npos) break;
      begin = end + 1;
    }
    for (std::string_view& value : values_) {
      if (value.size() >= 2 && value.front() == '"' && value.back() == '"')
        value = value.substr(1, value.size() - 2);
    }
    if (columns_.empty()) {
      Header();
    } else {
      Values();
    }
  }
  void Header() {
    std::array<bool, kFields.size()> seen{};
    for (std::string_view name : values_) {
      for (const std::string_view prefix : {"timestep_", "vehicle_"}) {
        if (name.starts_with(prefix)) {
          name.remove_prefix(prefix.size());
          break;
        }
      }
      columns_.push_back(FieldOf(name));
      if (!columns_.back()) continue;
      bool& is_second = seen[static_cast<std::size_t>(*columns_.back())];
      if (is_second) collector_->Fail(fmt::format("column '{}' occurs twice", name));
      is_second = true;
    }
    for (const Field needed : {Field::kTime, Field::kId, Field::kSpeed}) {
      if (seen[static_cast<std::size_t>(needed)]) continue;
      const std::string_view name = kFields[static_cast<std::size_t>(needed)].first;
      collector_->Fail(fmt::format("column '{}' (or '{}_{}') is missing", name,
                                   needed == Field::kTime ? "timestep" : "vehicle", name));
    }
  }
  void Values() {
    if (values_.size() != columns_.size())
      collector_->Fail(
          fmt::format("{} values; the header names {} columns", values_.size(), columns_.size()));
    Row row;
    bool has_speed = false;
    // Rows of persons, and of timesteps without vehicles, have no vehicle's id.
    for (std::size_t i = 0; i < values_.size(); ++i) {
      if (columns_[i] == Field::kId) row.id = values_[i];
      if (columns_[i] == Field::kTime) collector_->Set(Field::kTime, values_[i], &row);
    }
    collector_->Begin(row.time);
    if (row.id.empty()) return;
    for (std::size_t i = 0; i < values_.size(); ++i) {
      if (!columns_[i] || values_[i].empty()) continue;
      collector_->Set(*columns_[i], values_[i], &row);
      has_speed = has_speed || columns_[i] == Field::kSpeed;
    }
    if (!has_speed) collector_->Fail(fmt::format("vehicle '{}' has no speed", row.id));
    collector_->Add(std::move(row));
  }

  Collector* collector_;
  std::string rest_;
  std::int64_t line_{0};
  char separator_{','};
  std::vector<std::optional<Field>> columns_;
  std::vector<std::string_view> values_;
};

template <class Reader>
void ReadAll(std::string_view first, InputFile* file, const ReadProgress& progress, Reader* reader) {
  for (std::string_view piece = first; !piece.empty(); piece = file->Read()) {
    reader->Parse(piece, false);
    if (progress) progress(file->PartRead());
  }
  reader->Parse({}, true);
}

}  // namespace

FollowingData LoadFollowing(const fs::path& file, const FollowingOptions& options,
                            const ReadProgress& progress) {
  InputFile input(file);
  Collector collector(file.string(), options);
  const std::string_view first = input.Read();
  const std::size_t text = first.find_first_not_of(" \t\r\n\xef\xbb\xbf");
  if (text != std::string_view::npos && first[text] == '<') {
    FcdReader reader(file.string(), &collector);
    ReadAll(first, &input, progress, &reader);
  } else {
    CsvReader reader(&collector);
    ReadAll(first, &input, progress, &reader);
  }
  return collector.Finish();
}

std::map<std::string, double> LoadTypeLengths(const fs::path& file) {
  InputFile input(file);
  std::map<std::string, double> lengths;
  const XmlStream* reading = nullptr;
  XmlStream stream(file.string(), [&](const char* name, const char** attributes) {
    if (std::strcmp(name, "vType") != 0) return;
    std::string id, length;
    for (const char** a = attributes; *a != nullptr; a += 2) {
      if (std::strcmp(a[0], "id") == 0) id = a[1];
      if (std::strcmp(a[0], "length") == 0) length = a[1];
    }
    if (length.empty()) return;
    double value = 0.0;
    const auto [end, error] = std::from_chars(length.data(), length.data() + length.size(), value);
    if (error != std::errc{} || *end != '\0' || !(value >= 0.1 && value <= 1000.0))
      throw ConfigError(fmt::format("{}: line {}: length of vType '{}' is '{}'; allowed: 0.1 to 1000 [m]",
                                    file.string(), reading->line(), id, length));
    lengths[id] = value;
  });
  reading = &stream;
  for (std::string_view piece = input.Read(); !piece.empty(); piece = input.Read())
    stream.Parse(piece, false);
  stream.Parse({}, true);
  if (lengths.empty()) throw ConfigError(fmt::format("{}: no vType with a length", file.string()));
  return lengths;
}

}  // namespace lanewise
