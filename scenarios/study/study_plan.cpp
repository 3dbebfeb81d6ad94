#include "scenarios/study/study_plan.h"

#include <fmt/ranges.h>
#include <toml++/toml.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <unordered_set>

#include "agents/core/params.h"
#include "scenarios/input_file.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxValues = 100'000;  // Of one axis.

/// Options of `lanewise run` that the runner sets itself.
const std::set<std::string> kRunnersOwn = {"help",         "results",     "quiet",         "threads",
                                           "sumo-outputs", "progress-fd", "record-samples"};
/// Options that name files, relative to the study file.
const std::set<std::string> kFiles = {"configuration-file", "net-file", "route-files", "additional-files",
                                      "config"};

std::string KeyOf(const std::string& settings_json) {
  return fmt::format("{:016x}", XXH3_64bits(settings_json.data(), settings_json.size()));
}

/// Files of a comma-separated list, seen from a folder.
std::string FilesFrom(const fs::path& folder, const std::string& list) {
  std::vector<std::string> files;
  std::istringstream words(list);
  for (std::string file; std::getline(words, file, ',');) {
    const std::size_t start = file.find_first_not_of(' ');
    if (start != std::string::npos)
      files.push_back((folder / file.substr(start)).lexically_normal().string());
  }
  return fmt::format("{}", fmt::join(files, ","));
}

/// Settings that make no difference are dropped, so that equal runs are run once: nobody is equipped in a
/// native run, and with a penetration of 0 a run is native.
void Normalize(RunSettings* settings) {
  const auto find = [&](const char* name) {
    return std::find_if(settings->begin(), settings->end(), [&](const auto& s) { return s.first == name; });
  };
  const auto rate = find("penetration");
  if (rate != settings->end() && std::strtod(rate->second.c_str(), nullptr) == 0.0) {
    const auto policy = find("policy");
    if (policy != settings->end()) {
      policy->second = "sumo";
    } else {
      settings->emplace_back("policy", "sumo");
    }
  }
  const auto policy = find("policy");
  if (policy != settings->end() && policy->second == "sumo") {
    const auto again = find("penetration");
    if (again != settings->end()) settings->erase(again);
  }
  std::sort(settings->begin(), settings->end());
}

}  // namespace

std::string DidYouMean(const std::string& name, const std::vector<std::string>& names) {
  std::string nearest;
  std::size_t least = std::max<std::size_t>(3, name.size() / 2);
  for (const std::string& candidate : names) {
    const std::size_t distance = EditDistance(name, candidate);
    if (distance < least) {
      least = distance;
      nearest = candidate;
    }
  }
  return nearest.empty() ? "" : fmt::format("; did you mean '{}'?", nearest);
}

/// Turns TOML into blocks, checking every key.
class StudyPlan::Reader {
 public:
  Reader(const fs::path& file, const RunInterface& run) : file_(file) {
    for (const RunInterface::Option& option : run.options) {
      if (kRunnersOwn.count(option.name) != 0 || option.name == "set") continue;
      keys_.push_back(option.name);
      if (option.flag) flags_.push_back(option.name);
    }
    keys_.emplace_back("set");
    keys_.emplace_back("sumo");
  }

  void Read(StudyPlan* plan) {
    plan->file_ = file_;
    plan->flags_ = flags_;
    plan->text_ = ReadText(file_);
    plan->name_ = file_.stem().string();
    toml::table root;
    try {
      root = toml::parse(plan->text_, file_.string());
    } catch (const toml::parse_error& error) {
      throw ConfigError(fmt::format("{}, line {}: broken TOML: {}", file_.string(), error.source().begin.line,
                                    error.description()));
    }
    static const std::vector<std::string> kSections = {"name", "question", "run", "grid", "runs"};
    std::vector<Axis> common;
    for (const auto& [key, node] : root) {
      const std::string name{key.str()};
      if (std::find(kSections.begin(), kSections.end(), name) == kSections.end()) {
        const bool option = std::find(keys_.begin(), keys_.end(), name) != keys_.end();
        Fail(node, fmt::format("unknown key '{}'{}; allowed: {}", name,
                               option ? " (an option of a run belongs below [run] or [grid])"
                                      : DidYouMean(name, kSections),
                               fmt::join(kSections, ", ")));
      }
      if (name == "name" || name == "question") {
        if (!node.is_string()) Fail(node, fmt::format("'{}' is no text", name));
        (name == "name" ? plan->name_ : plan->question_) = *node.value<std::string>();
      }
    }
    if (const toml::node* run = root.get("run")) {
      common = ReadAxes(Table(*run, "run"), /*lists=*/false);
    }
    if (const toml::node* grid = root.get("grid"))
      plan->blocks_.push_back(MakeBlock(common, ReadAxes(Table(*grid, "grid"), true), *grid));
    if (const toml::node* runs = root.get("runs")) {
      const toml::array* list = runs->as_array();
      if (list == nullptr) Fail(*runs, "'runs' is no list; write [[runs]] above each entry");
      for (const toml::node& entry : *list)
        plan->blocks_.push_back(MakeBlock(common, ReadAxes(Table(entry, "runs"), true), entry));
    }
    if (plan->blocks_.empty())
      throw ConfigError(fmt::format("{}: it asks for no runs; allowed: [grid], or [[runs]]", file_.string()));
  }

 private:
  [[noreturn]] void Fail(const toml::node& node, const std::string& what) const {
    throw ConfigError(fmt::format("{}, line {}: {}", file_.string(), node.source().begin.line, what));
  }

  const toml::table& Table(const toml::node& node, const char* name) const {
    if (!node.is_table()) Fail(node, fmt::format("'{}' is no table", name));
    return *node.as_table();
  }

  /// A single value as the command line takes it.
  std::string Text(const toml::node& node, const std::string& key) const {
    if (const auto* text = node.as_string()) return text->get();
    if (const auto* number = node.as_integer()) return fmt::format("{}", number->get());
    if (const auto* number = node.as_floating_point()) return fmt::format("{}", number->get());
    if (const auto* flag = node.as_boolean()) return flag->get() ? "true" : "false";
    Fail(node, fmt::format("'{}' is neither text, number nor true/false", key));
  }

  std::vector<std::string> Values(const toml::node& node, const std::string& key, bool lists) const {
    std::vector<std::string> values;
    if (const toml::table* range = node.as_table()) {
      values = Range(*range, key);
    } else if (const toml::array* array = node.as_array()) {
      if (array->empty()) Fail(node, fmt::format("'{}' is an empty list", key));
      for (const toml::node& value : *array) values.push_back(Text(value, key));
    } else {
      values.push_back(Text(node, key));
    }
    if (!lists && values.size() > 1)
      Fail(node,
           fmt::format("'{}' is a list; below [run] a single value is allowed, lists below [grid]", key));
    if (std::set(values.begin(), values.end()).size() < values.size())
      Fail(node, fmt::format("'{}' holds a value twice", key));
    return values;
  }

  /// { from = 1, count = 20 } or { from = 0.0, to = 1.0, step = 0.1 }.
  std::vector<std::string> Range(const toml::table& range, const std::string& key) const {
    static const std::vector<std::string> kNames = {"from", "to", "step", "count"};
    for (const auto& [name, node] : range) {
      const std::string text{name.str()};
      if (std::find(kNames.begin(), kNames.end(), text) == kNames.end() || !node.is_number())
        Fail(node,
             fmt::format("'{}' of '{}'; allowed: a list, or {{ from, to, step }} or {{ from, count, step }}, "
                         "numbers{}",
                         text, key, DidYouMean(text, kNames)));
    }
    const double from = range["from"].value_or(1.0), step = range["step"].value_or(1.0);
    const bool has_to = range.contains("to"), has_count = range.contains("count");
    if (has_to == has_count || !(step > 0.0))
      Fail(range, fmt::format("'{}': one of to and count is needed, and a step above 0", key));
    const double count = has_count ? range["count"].value_or(0.0)
                                   : std::floor((range["to"].value_or(0.0) - from) / step + 1e-9) + 1.0;
    if (!(count >= 1.0 && count <= static_cast<double>(kMaxValues)))
      Fail(range, fmt::format("'{}' has {} values; allowed: 1 to {}", key, count, kMaxValues));
    std::vector<std::string> values;
    // Twelve digits: 0.1 * 3 is to be 0.3.
    for (std::int64_t i = 0; i < static_cast<std::int64_t>(count); ++i)
      values.push_back(fmt::format("{:.12g}", from + static_cast<double>(i) * step));
    return values;
  }

  void ReadParameters(const toml::table& table, const std::string& prefix, bool lists,
                      std::vector<Axis>* axes) const {
    static const RunParams kDefaults;
    static const std::vector<ParamDescription> kParams = DescribeParams(kDefaults);
    for (const auto& [key, node] : table) {
      const std::string name =
          prefix.empty() ? std::string(key.str()) : prefix + "." + std::string(key.str());
      const bool parameter = std::any_of(kParams.begin(), kParams.end(),
                                         [&](const ParamDescription& p) { return p.name == name; });
      if (!parameter && node.is_table()) {
        ReadParameters(*node.as_table(), name, lists, axes);
        continue;
      }
      if (!parameter) {
        std::vector<std::string> names;
        for (const ParamDescription& p : kParams) names.push_back(p.name);
        Fail(node, fmt::format("unknown parameter '{}'{}; `lanewise params` lists all", name,
                               DidYouMean(name, names)));
      }
      axes->push_back({"set." + name, Values(node, "set." + name, lists)});
    }
  }

  std::vector<Axis> ReadAxes(const toml::table& table, bool lists) const {
    std::vector<Axis> axes;
    for (const auto& [key, node] : table) {
      const std::string name{key.str()};
      if (kRunnersOwn.count(name) != 0)
        Fail(node, fmt::format("'{}' is set by the study's runner and cannot be studied", name));
      if (std::find(keys_.begin(), keys_.end(), name) == keys_.end()) {
        Fail(node, fmt::format("unknown key '{}'{}; allowed: {}", name, DidYouMean(name, keys_),
                               fmt::join(keys_, ", ")));
      }
      if (name == "set") {
        ReadParameters(Table(node, "set"), "", lists, &axes);
      } else {
        axes.push_back({name, Values(node, name, lists)});
      }
    }
    return axes;
  }

  Block MakeBlock(const std::vector<Axis>& common, std::vector<Axis> own, const toml::node& node) const {
    Block block;
    block.line = node.source().begin.line;
    for (const Axis& axis : common) {
      if (std::none_of(own.begin(), own.end(), [&](const Axis& o) { return o.name == axis.name; }))
        own.push_back(axis);
    }
    std::size_t combinations = 1;
    for (Axis& axis : own) {
      combinations *= axis.values.size();
      if (combinations > 100'000'000) Fail(node, "it has more than 100,000,000 combinations");
      if (axis.name != "seed") {
        block.axes.push_back(std::move(axis));
        continue;
      }
      for (const std::string& seed : axis.values) {
        char* end = nullptr;
        block.seeds.push_back(std::strtoll(seed.c_str(), &end, 10));
        if (*end != '\0') Fail(node, fmt::format("seed '{}' is no whole number", seed));
      }
    }
    if (block.seeds.empty()) block.seeds.push_back(RunConfig{}.seed);
    std::sort(block.axes.begin(), block.axes.end(),
              [](const Axis& a, const Axis& b) { return a.name < b.name; });
    return block;
  }

  fs::path file_;
  std::vector<std::string> keys_, flags_;
};

StudyPlan StudyPlan::Load(const fs::path& file, const RunInterface& run) {
  if (!fs::exists(file)) throw ConfigError(fmt::format("{}: no such file", file.string()));
  if (fs::is_directory(file))
    throw ConfigError(fmt::format("{}: is a folder; a study file (TOML) is wanted", file.string()));
  StudyPlan plan;
  Reader(file, run).Read(&plan);
  return plan;
}

std::int64_t StudyPlan::seeds() const {
  std::size_t most = 0;
  for (const Block& block : blocks_) most = std::max(most, block.seeds.size());
  return static_cast<std::int64_t>(most);
}

void StudyPlan::ForEach(std::int64_t extra_seeds, const std::function<void(const PlannedRun&)>& visit) const {
  const auto rounds = static_cast<std::size_t>(seeds() + extra_seeds);
  std::unordered_set<std::string> seen;  // Keys: 16 characters.
  std::int64_t number = 0;
  PlannedRun run;
  for (std::size_t round = 0; round < rounds; ++round) {
    for (const Block& block : blocks_) {
      const std::size_t listed = block.seeds.size();
      if (round >= listed + static_cast<std::size_t>(extra_seeds)) continue;
      const std::int64_t seed = round < listed ? block.seeds[round]
                                               : *std::max_element(block.seeds.begin(), block.seeds.end()) +
                                                     static_cast<std::int64_t>(round - listed + 1);
      std::vector<std::size_t> digit(block.axes.size(), 0);
      while (true) {
        run.settings.clear();
        for (std::size_t k = 0; k < digit.size(); ++k)
          run.settings.emplace_back(block.axes[k].name, block.axes[k].values[digit[k]]);
        run.settings.emplace_back("seed", fmt::format("{}", seed));
        Normalize(&run.settings);
        run.key = KeyOf(ToJson(run.settings));
        if (seen.insert(run.key).second) {
          run.number = ++number;
          visit(run);
        }
        std::size_t k = digit.size();  // Counts up, the last axis fastest.
        while (k > 0 && ++digit[k - 1] == block.axes[k - 1].values.size()) digit[--k] = 0;
        if (k == 0) break;
      }
    }
  }
}

void StudyPlan::Check(const RunInterface& run) const {
  for (const Block& block : blocks_) {
    StudyPlan one;
    one.file_ = file_;
    one.flags_ = flags_;
    one.blocks_ = {block};
    one.blocks_[0].seeds.resize(1);
    one.ForEach(0, [&](const PlannedRun& planned) {
      std::vector<std::string> arguments = one.Arguments(planned.settings), sumo;
      const auto dashes = std::find(arguments.begin(), arguments.end(), "--");
      if (dashes != arguments.end()) {
        sumo.assign(dashes + 1, arguments.end());
        arguments.erase(dashes, arguments.end());
      }
      try {
        run.parse(arguments, sumo);
      } catch (const ConfigError& error) {
        throw ConfigError(fmt::format("{}, entry at line {}: run '{}': {}", file_.string(), block.line,
                                      ToText(planned.settings), error.what()));
      }
    });
    for (const std::int64_t seed : block.seeds) {
      if (seed < 0 || seed > 2147483647)
        throw ConfigError(fmt::format("{}, entry at line {}: seed {}; allowed: 0 to 2147483647",
                                      file_.string(), block.line, seed));
    }
  }
}

std::vector<std::string> StudyPlan::Arguments(const RunSettings& settings) const {
  const fs::path folder = fs::absolute(file_).parent_path();
  std::vector<std::string> arguments, sumo;
  for (const auto& [name, value] : settings) {
    if (name == "sumo") {
      std::istringstream words(value);
      for (std::string word; words >> word;) sumo.push_back(word);
    } else if (name.starts_with("set.")) {
      arguments.insert(arguments.end(), {"--set", fmt::format("{}={}", name.substr(4), value)});
    } else if (std::find(flags_.begin(), flags_.end(), name) != flags_.end()) {
      if (value == "true") arguments.push_back("--" + name);
    } else {
      arguments.insert(arguments.end(),
                       {"--" + name, kFiles.count(name) != 0 ? FilesFrom(folder, value) : value});
    }
  }
  if (!sumo.empty()) arguments.emplace_back("--");
  arguments.insert(arguments.end(), sumo.begin(), sumo.end());
  return arguments;
}

std::string ToText(const RunSettings& settings) {
  std::vector<std::string> words;
  for (const auto& [name, value] : settings) words.push_back(name + "=" + value);
  return fmt::format("{}", fmt::join(words, " "));
}

std::string ToJson(const RunSettings& settings) {
  nlohmann::json json = nlohmann::json::object();
  for (const auto& [name, value] : settings) json[name] = value;
  return json.dump();
}

RunSettings SettingsFromJson(const std::string& json) {
  RunSettings settings;
  const nlohmann::json object = nlohmann::json::parse(json);
  for (const auto& [name, value] : object.items()) settings.emplace_back(name, value);
  return settings;
}

}  // namespace lanewise
