#include "agents/sector_net/samples.h"

#include <fmt/core.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <tuple>

#include "agents/core/check.h"
#include "agents/core/random.h"

namespace lanewise {
namespace {

constexpr std::array<const char*, kNetInputs + kNetOutputs> kColumns{
    "sector_0_free", "sector_1_free", "sector_2_free", "sector_3_free", "sector_4_free", "sector_5_free",
    "sector_6_free", "sector_7_free", "left",          "forward",       "right"};

std::string_view Trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(" \t\r");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

std::vector<std::string_view> Fields(std::string_view line) {
  std::vector<std::string_view> fields;
  for (std::size_t begin = 0;;) {
    const auto comma = line.find(',', begin);
    fields.push_back(Trimmed(line.substr(begin, comma - begin)));
    if (comma == std::string_view::npos) return fields;
    begin = comma + 1;
  }
}

[[noreturn]] void Refuse(std::string_view origin, std::size_t line, const std::string& reason) {
  throw ConfigError(fmt::format("{}: line {}: {}", origin, line, reason));
}

/// Place of each of kColumns in a row; the header says so.
class Columns {
 public:
  Columns(std::string_view header, std::string_view origin, std::size_t line) {
    const auto names = Fields(header);
    count_ = names.size();
    place_.fill(count_);
    for (std::size_t i = 0; i < names.size(); ++i) {
      const auto known = std::find(kColumns.begin(), kColumns.end(), names[i]);
      if (known == kColumns.end()) {
        if (names[i] == "time_s" || names[i] == "vehicle") continue;
        Refuse(
            origin, line,
            fmt::format("unknown column '{}'; allowed: sector_0_free to sector_7_free, left, forward, right, "
                        "time_s, vehicle",
                        names[i]));
      }
      std::size_t& place = place_[static_cast<std::size_t>(known - kColumns.begin())];
      if (place != count_) Refuse(origin, line, fmt::format("column '{}' appears twice", names[i]));
      place = i;
    }
    for (std::size_t c = 0; c < kColumns.size(); ++c) {
      if (place_[c] == count_) Refuse(origin, line, fmt::format("column '{}' is missing", kColumns[c]));
    }
  }

  LabelledScan Read(std::string_view row, std::string_view origin, std::size_t line) const {
    const auto fields = Fields(row);
    if (fields.size() != count_)
      Refuse(origin, line, fmt::format("{} values; the header names {} columns", fields.size(), count_));
    const auto number = [&](std::size_t column) {
      const std::string_view text = fields[place_[column]];
      double value = 0.0;
      const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
      if (error != std::errc{} || end != text.data() + text.size() || !(value >= 0.0 && value <= 1.0))
        Refuse(origin, line,
               fmt::format("{} is '{}'; allowed: a number from 0 to 1", kColumns[column], text));
      return value;
    };
    LabelledScan sample;
    for (std::size_t i = 0; i < kNetInputs; ++i) sample.sectors[i] = number(i);
    NetOutputs label;
    for (std::size_t k = 0; k < kNetOutputs; ++k) label[k] = number(kNetInputs + k);
    sample.way = WayOf(label);
    if (label != TargetOf(sample.way))
      Refuse(origin, line,
             fmt::format("left, forward, right is {} {} {}; allowed: a unit vector, one 1 and two 0",
                         label[0], label[1], label[2]));
    return sample;
  }

 private:
  std::size_t count_;
  std::array<std::size_t, kColumns.size()> place_;
};

}  // namespace

std::vector<LabelledScan> ParseSamples(std::string_view text, std::string_view origin) {
  std::vector<LabelledScan> samples;
  std::optional<Columns> columns;
  std::size_t line = 0;
  while (!text.empty()) {
    ++line;
    const auto end = std::min(text.find('\n'), text.size());
    const std::string_view row = Trimmed(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
    if (row.empty() || row.front() == '#') continue;
    if (!columns) {
      columns.emplace(row, origin, line);
    } else {
      samples.push_back(columns->Read(row, origin, line));
    }
  }
  if (samples.empty())
    throw ConfigError(fmt::format("{}: no samples; expected a line of column names, then rows", origin));
  return samples;
}

std::vector<LabelledScan> LoadSamples(const std::filesystem::path& file) {
  if (!std::filesystem::exists(file)) throw ConfigError(fmt::format("{}: no such file", file.string()));
  std::ifstream in(file, std::ios::binary);
  if (std::filesystem::is_directory(file) || !in)
    throw ConfigError(fmt::format("{}: cannot be read", file.string()));
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  return ParseSamples(text, file.string());
}

SampleWriter::SampleWriter(const std::filesystem::path& file, std::string_view note)
    : file_(file), out_(file) {
  if (!out_) throw ConfigError(fmt::format("{}: cannot be created", file.string()));
  out_ << "# Lanewise sector samples. sector_i_free [-]: 1 free, 0 obstacle, 0 is the left sector of the "
          "front "
          "180 deg;\n# left, forward, right [-]: the way taken; time_s [s]\n";
  if (!note.empty()) {
    std::string line(note);
    std::replace(line.begin(), line.end(), '\n', ' ');
    out_ << "# " << line << '\n';
  }
  out_ << "time_s,vehicle";
  for (const char* column : kColumns) out_ << ',' << column;
  out_ << '\n';
}

void SampleWriter::Finish() {
  out_.close();
  if (!out_) throw ConfigError(fmt::format("{}: could not be written; is the disk full?", file_.string()));
}

void SampleWriter::Add(double time, std::string_view vehicle, const SectorInputs& sectors, Avoidance way) {
  std::string row = fmt::format("{:.3f},", time);
  // A comma would begin a new column.
  for (const char c : vehicle) row += c == ',' || c == '\n' || c == '\r' ? '_' : c;
  for (const double sector : sectors) row += fmt::format(",{}", sector);
  for (const double target : TargetOf(way)) row += fmt::format(",{}", target);
  out_ << row << '\n';
  ++count_;
}

Avoidance WayByRule(std::uint8_t code) {
  LANEWISE_CHECK(code != 0);
  constexpr unsigned kLeftHalf = 0x0f, kAhead = 0x18;
  if ((code & kAhead) == kAhead) return Avoidance::kForward;
  const int left = std::popcount(code & kLeftHalf), right = std::popcount(code & ~kLeftHalf & 0xffu);
  return left >= right ? Avoidance::kLeft : Avoidance::kRight;
}

std::vector<LabelledScan> GeneratedSamples() {
  std::vector<LabelledScan> samples;
  for (unsigned code = 1; code < 256; ++code) {
    const auto byte = static_cast<std::uint8_t>(code);
    samples.push_back({InputsOfCode(byte), WayByRule(byte)});
  }
  return samples;
}

SampleSplit SplitSamples(std::vector<LabelledScan> samples, std::size_t training, std::size_t test,
                         std::uint64_t seed) {
  if (samples.size() < training + test) {
    throw ConfigError(
        fmt::format("{} samples; needed: {} to train and {} to test, which are drawn without "
                    "putting back",
                    samples.size(), training, test));
  }
  // The first of Fisher's and Yates' exchanges suffice.
  const RandomStream random(seed, 0, RandomPurpose::kTrainingSplit, 0);
  for (std::size_t i = 0; i < training + test; ++i) {
    const auto rest = static_cast<double>(samples.size() - i);
    std::swap(samples[i], samples[i + static_cast<std::size_t>(rest * random.Uniform(i))]);
  }
  const auto middle = samples.begin() + static_cast<std::ptrdiff_t>(training);
  return {{samples.begin(), middle}, {middle, middle + static_cast<std::ptrdiff_t>(test)}};
}

std::vector<LabelledScan> MergeEqual(const std::vector<LabelledScan>& samples) {
  std::vector<LabelledScan> merged;
  std::map<std::pair<SectorInputs, Avoidance>, std::size_t> place;
  for (const LabelledScan& sample : samples) {
    const auto [it, is_new] = place.try_emplace({sample.sectors, sample.way}, merged.size());
    if (is_new) {
      merged.push_back(sample);
    } else {
      merged[it->second].weight += sample.weight;
    }
  }
  return merged;
}

void BalanceWays(std::vector<LabelledScan>* samples) {
  NetOutputs sum{};
  for (const LabelledScan& sample : *samples) sum[static_cast<std::size_t>(sample.way)] += sample.weight;
  const double total = sum[0] + sum[1] + sum[2];
  const auto ways =
      static_cast<double>(std::count_if(sum.begin(), sum.end(), [](double s) { return s > 0.0; }));
  for (LabelledScan& sample : *samples)
    sample.weight *= total / (ways * sum[static_cast<std::size_t>(sample.way)]);
}

std::size_t CountSeen(const SampleSplit& split) {
  std::set<SectorInputs> seen;
  for (const LabelledScan& sample : split.training) seen.insert(sample.sectors);
  return static_cast<std::size_t>(std::count_if(
      split.test.begin(), split.test.end(), [&](const LabelledScan& s) { return seen.contains(s.sectors); }));
}

}  // namespace lanewise
