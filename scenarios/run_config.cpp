#include "scenarios/run_config.h"

#include <fmt/ranges.h>

#include <toml++/toml.h>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <pugixml.hpp>
#include <set>

namespace lanewise {
namespace {

namespace fs = std::filesystem;

/// SUMO's option for how often [s] a vehicle works out its driving.
constexpr const char* kActionStep = "default.action-step-length";
/// SUMO's option for how long [s] a vehicle must stand in a junction until nobody waits for it any more, and
/// its value where agents, who see its body and pass beside it or wait, drive under SUMO's rules.
constexpr const char* kJunctionBlocker = "ignore-junction-blocker";
constexpr const char* kBlockerTime = "10";
/// SUMO's option for how long [s] a vehicle waits until it accepts the smallest gap, and its value for
/// agents: the default of rules.patience, their own.
constexpr const char* kImpatience = "time-to-impatience";
constexpr const char* kImpatienceTime = "60";

/// SUMO's options under their long names, by the section that holds them in a .sumocfg, may also be written
/// short.
const char* LongName(const std::string& name) {
  static const std::pair<const char*, const char*> kShort[] = {{"n", "net-file"},
                                                               {"net", "net-file"},
                                                               {"r", "route-files"},
                                                               {"a", "additional-files"},
                                                               {"additional", "additional-files"},
                                                               {"b", "begin"},
                                                               {"e", "end"}};
  for (const auto& [brief, full] : kShort) {
    if (name == brief) return full;
  }
  return name.c_str();
}

/// [s] from SUMO's time notation: seconds, or [days:]hours:minutes:seconds. @throws ConfigError.
double ParseTime(const std::string& text, const std::string& origin) {
  double total = 0.0;
  const double weight[] = {1.0, 60.0, 3600.0, 86400.0};
  std::vector<double> parts;
  std::size_t from = 0;
  while (true) {
    const std::size_t colon = text.find(':', from);
    const std::string part = text.substr(from, colon == std::string::npos ? colon : colon - from);
    char* end = nullptr;
    parts.push_back(std::strtod(part.c_str(), &end));
    if (part.empty() || *end != '\0' || parts.size() > 4) {
      throw ConfigError(fmt::format("{}: '{}' is no time; allowed: seconds or [d:]hh:mm:ss", origin, text));
    }
    if (colon == std::string::npos) break;
    from = colon + 1;
  }
  for (std::size_t i = 0; i < parts.size(); ++i) total += parts[parts.size() - 1 - i] * weight[i];
  return total;
}

std::vector<fs::path> SplitFiles(const std::string& list, const fs::path& base) {
  std::vector<fs::path> files;
  std::size_t from = 0;
  while (from <= list.size()) {
    std::size_t comma = list.find(',', from);
    if (comma == std::string::npos) comma = list.size();
    std::string name = list.substr(from, comma - from);
    name.erase(0, name.find_first_not_of(" \t\n"));
    name.erase(name.find_last_not_of(" \t\n") + 1);
    if (!name.empty()) files.push_back(fs::path(name).is_absolute() ? fs::path(name) : base / name);
    from = comma + 1;
  }
  return files;
}

bool WritesFile(const std::string& option, const std::string& section) {
  const auto ends_with = [&](const char* tail) { return option.ends_with(tail); };
  return ends_with("-output") || ends_with(".output") || option == "log" || option == "message-log" ||
         option == "error-log" || (section == "output" && option == "save-state.prefix");
}

bool Has(const std::vector<std::string>& options, const std::string& name) {
  return std::find(options.begin(), options.end(), name) != options.end();
}

/// An option among SUMO's arguments: `--name value`, `--name=value` or a name alone.
struct GivenOption {
  std::string name;  ///< Long.
  std::string value;
  std::size_t first{0}, count{1};  ///< Its words.
};

std::vector<GivenOption> GivenOptions(const std::vector<std::string>& arguments) {
  const auto is_option = [](const std::string& word) {
    return word.size() > 1 && word[0] == '-' && (word[1] < '0' || word[1] > '9') &&
           word.find_first_not_of('-') != std::string::npos;
  };
  std::vector<GivenOption> options;
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    const std::string& word = arguments[i];
    if (!is_option(word)) continue;
    const std::size_t start = word.find_first_not_of('-'), equals = word.find('=');
    GivenOption& option = options.emplace_back();
    option.name = LongName(word.substr(start, equals == std::string::npos ? equals : equals - start));
    option.first = i;
    if (equals != std::string::npos) {
      option.value = word.substr(equals + 1);
    } else if (i + 1 < arguments.size() && !is_option(arguments[i + 1])) {
      option.value = arguments[++i];
      option.count = 2;
    }
  }
  return options;
}

/// Existing files that an option behind `--` reads.
std::vector<fs::path> FilesRead(const GivenOption& option) {
  if (option.value.empty() || WritesFile(option.name, "")) return {};
  std::vector<fs::path> files = SplitFiles(option.value, "");
  std::error_code error;
  std::erase_if(files, [&](const fs::path& file) { return !fs::is_regular_file(file, error); });
  return files;
}

/// What of SUMO's arguments repeats the traffic: no outputs, and files wherever it is repeated from.
std::vector<std::string> RepeatSumoOptions(const std::vector<std::string>& arguments) {
  std::vector<std::string> words = arguments;
  std::vector<bool> kept(words.size(), true);
  for (const GivenOption& option : GivenOptions(arguments)) {
    const std::size_t last = option.first + option.count - 1;
    if (WritesFile(option.name, "")) {
      for (std::size_t i = option.first; i <= last; ++i) kept[i] = false;
    } else if (const auto files = FilesRead(option);
               !files.empty() && files.size() == SplitFiles(option.value, "").size()) {
      std::vector<std::string> absolute;
      for (const fs::path& file : files) absolute.push_back(fs::absolute(file).lexically_normal().string());
      words[last] =
          fmt::format("{}{}", option.count == 2 ? "" : "--" + option.name + "=", fmt::join(absolute, ","));
    }
  }
  std::vector<std::string> repeated;
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (kept[i]) repeated.push_back(words[i]);
  }
  return repeated;
}

fs::path NetworksFolder() {
  if (const char* folder = std::getenv("LANEWISE_NETWORKS")) return folder;
  std::error_code error;  // Installed: beside the program.
  const fs::path installed =
      fs::read_symlink("/proc/self/exe", error).parent_path() / "../share/lanewise/networks";
  if (!error && fs::is_directory(installed, error)) return installed.lexically_normal();
  return LANEWISE_NETWORKS_FOLDER;
}

}  // namespace

SumoConfigFile ReadSumoConfig(const fs::path& file) {
  if (!fs::exists(file)) throw ConfigError(fmt::format("{}: no such file", file.string()));
  if (fs::is_directory(file))
    throw ConfigError(fmt::format("{}: is a folder; a .sumocfg file is wanted", file.string()));
  pugi::xml_document document;
  const pugi::xml_parse_result result = document.load_file(file.c_str());
  if (!result) {
    throw ConfigError(
        fmt::format("{}: broken XML at byte {}: {}", file.string(), result.offset, result.description()));
  }
  const pugi::xml_node root = document.document_element();
  const std::string name = root.name();
  if (name != "configuration" && name != "sumoConfiguration") {
    throw ConfigError(fmt::format("{}: root element is <{}>; a SUMO configuration has <configuration>",
                                  file.string(), name));
  }
  SumoConfigFile config;
  const fs::path base = file.parent_path();
  const auto read_option = [&](const pugi::xml_node& node, const std::string& section) {
    const std::string option = LongName(node.name());
    const std::string value = node.attribute("value").as_string(node.attribute("v").as_string());
    config.options.push_back(option);
    if (option == "net-file")
      config.net_file = SplitFiles(value, base).empty() ? fs::path() : SplitFiles(value, base).front();
    if (option == "net-file" || option == "route-files" || option == "additional-files") {
      const auto files = SplitFiles(value, base);
      config.inputs.insert(config.inputs.end(), files.begin(), files.end());
    } else if (section == "input") {  // Weights, districts and the like.
      for (const fs::path& file : SplitFiles(value, base)) {
        std::error_code error;
        if (fs::is_regular_file(file, error)) config.inputs.push_back(file);
      }
    }
    if (option == "end") config.end = ParseTime(value, file.string() + ", option end");
    if (option == "begin") config.begin = ParseTime(value, file.string() + ", option begin");
    if (WritesFile(option, section) && !value.empty())
      config.outputs.emplace_back(option, fs::path(value).filename());
  };
  for (const pugi::xml_node section : root.children()) {
    if (section.type() != pugi::node_element) continue;
    if (section.attribute("value") || section.attribute("v")) read_option(section, "");
    for (const pugi::xml_node option : section.children()) {
      if (option.type() == pugi::node_element) read_option(option, section.name());
    }
  }
  if (config.end && *config.end < 0) config.end.reset();
  return config;
}

std::vector<std::string> ShippedScenarios() {
  std::set<std::string> names;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(NetworksFolder(), error)) {
    if (fs::exists(entry.path() / (entry.path().filename().string() + ".sumocfg")))
      names.insert(entry.path().filename());
  }
  return {names.begin(), names.end()};
}

fs::path FindShippedScenario(const std::string& name) {
  const fs::path file = NetworksFolder() / name / (name + ".sumocfg");
  if (!name.empty() && fs::exists(file)) return file;
  throw ConfigError(fmt::format("--scenario: unknown scenario '{}'; allowed: {} (in {})", name,
                                fmt::join(ShippedScenarios(), ", "), NetworksFolder().string()));
}

void Resolve(RunConfig* config) {
  if (config->config_file.empty() == config->net_file.empty()) {
    throw ConfigError("a run needs either -c FILE.sumocfg, --scenario NAME, or -n NET -r ROUTES");
  }
  if (!config->config_file.empty()) {
    const SumoConfigFile file = ReadSumoConfig(config->config_file);
    config->net_file = file.net_file;
    if (config->net_file.empty()) {
      throw ConfigError(fmt::format("{}: option net-file is missing; Lanewise reads the network itself",
                                    config->config_file.string()));
    }
    if (!config->end) config->end = file.end;
    if (config->scenario.empty()) {
      const fs::path stem = config->config_file.stem();
      const fs::path parent = fs::absolute(config->config_file).parent_path().filename();
      config->scenario = stem == parent ? stem.string() : (parent / stem).string();
    }
    for (const fs::path& input : file.inputs) {
      if (!fs::exists(input))
        throw ConfigError(
            fmt::format("{}: names {}, which does not exist", config->config_file.string(), input.string()));
    }
  } else {
    if (config->route_files.empty()) throw ConfigError("-n/--net-file needs -r/--route-files");
    if (config->scenario.empty()) config->scenario = config->net_file.stem().stem().string();
    for (const fs::path& input : InputFiles(*config)) {
      if (!fs::exists(input)) throw ConfigError(fmt::format("{}: no such file", input.string()));
    }
  }
  const auto check = [](const char* option, double value, double min, double max, const char* unit) {
    if (!(value >= min && value <= max)) {
      throw ConfigError(fmt::format("{}: {} {}; allowed: {} to {} {}", option, value, unit, min, max, unit));
    }
  };
  check("--step-length", config->step_length, 0.01, 1.0, "s");
  check("--threads", config->threads, 0, 1024, "threads");
  check("--sample-period", config->sample_period, 0, 86400, "s");
  check("--penetration", config->penetration, 0, 1, "of the vehicles");
  check("--edge-interval", config->edge_interval, 0, 86400, "s");
  check("--seed", static_cast<double>(config->seed), 0, 2147483647.0, "");
  const SafetyParams& safety = config->safety;
  if (safety.event_after > safety.separation_time) {
    throw ConfigError(
        fmt::format("parameter 'safety.event_after' is {} s; allowed: at most safety.separation_time, {} s",
                    safety.event_after, safety.separation_time));
  }
  CheckV2xParams(config->params.v2x);
  if (config->samples_file) {
    check("--samples-period", config->samples.period, config->step_length, 86400, "s");
    check("--samples-horizon", config->samples.horizon, config->step_length, 60, "s");
    check("--samples-shift", config->samples.min_shift, 0.01, 10, "m");
    const fs::path& file = *config->samples_file;
    if (fs::exists(file))
      throw ConfigError(
          fmt::format("--record-samples: {}: it exists; name a new file, or remove it", file.string()));
    if (file.has_parent_path() && !fs::is_directory(file.parent_path()))
      throw ConfigError(fmt::format("--record-samples: {}: its folder does not exist", file.string()));
  }
  if (config->end) check("--end", *config->end, config->step_length, 1e9, "s");
}

std::vector<fs::path> InputFiles(const RunConfig& config) {
  std::vector<fs::path> files;
  const auto add = [&](const std::vector<fs::path>& more) {
    files.insert(files.end(), more.begin(), more.end());
  };
  if (!config.config_file.empty()) {
    files.push_back(config.config_file);
    add(ReadSumoConfig(config.config_file).inputs);
  } else {
    files.push_back(config.net_file);
    add(SplitFiles(config.route_files, ""));
    add(SplitFiles(config.additional_files, ""));
  }
  for (const GivenOption& option : GivenOptions(config.sumo_options)) add(FilesRead(option));
  return files;
}

double PassiveActionStep(const RunConfig& config) {
  if (config.rules != Rules::kAgent || config.policy == Policy::kSumo || config.penetration < 1.0) return 0.0;
  std::vector<std::string> given;
  if (!config.config_file.empty()) given = ReadSumoConfig(config.config_file).options;
  for (const GivenOption& option : GivenOptions(config.sumo_options)) given.push_back(option.name);
  if (Has(given, kActionStep)) return 0.0;
  return std::max(1.0, std::round(1.0 / config.step_length)) * config.step_length;
}

std::vector<std::string> SumoCommandLine(const RunConfig& config) {
  std::vector<std::string> line;
  std::vector<std::string> given;
  for (const GivenOption& option : GivenOptions(config.sumo_options)) given.push_back(option.name);
  const auto add = [&](const std::string& option, const std::string& value) {
    line.push_back("--" + option);
    line.push_back(value);
  };
  if (!config.config_file.empty()) {
    const SumoConfigFile file = ReadSumoConfig(config.config_file);
    add("configuration-file", config.config_file.string());
    if (!config.sumo_output_folder.empty()) {
      for (const auto& [option, name] : file.outputs) {
        if (!Has(given, option)) add(option, (config.sumo_output_folder / name).string());
      }
    }
    given.insert(given.end(), file.options.begin(), file.options.end());
  } else {
    add("net-file", config.net_file.string());
    add("route-files", config.route_files);
    if (!config.additional_files.empty()) add("additional-files", config.additional_files);
  }
  // What the comparison needs, unless the user says otherwise (jams must not teleport; SUMO's own collision
  // handling must not remove vehicles).
  const std::pair<const char*, const char*> defaults[] = {
      {"time-to-teleport", "-1"},       {"collision.action", "warn"},
      {"collision.mingap-factor", "0"}, {"collision.check-junctions", "true"},
      {"no-step-log", "true"},          {"no-warnings", "true"}};
  for (const auto& [option, value] : defaults) {
    if (!Has(given, option)) add(option, value);
  }
  const double passive_step = PassiveActionStep(config);
  if (passive_step > 0.0) add(kActionStep, fmt::format("{}", passive_step));
  // Because of an action step SUMO would change to the ballistic method, and no more drive exactly what
  // agents command.
  const bool acts_rarely = passive_step > 0.0 || Has(given, kActionStep);
  if (acts_rarely && config.policy != Policy::kSumo && !Has(given, "step-method.ballistic"))
    add("step-method.ballistic", "false");
  // Two that each stand in the other's way in a junction would wait for SUMO's word for ever; and agents come
  // to a yield line more slowly than SUMO counts on, so gaps that it finds large enough are rarer.
  if (config.rules == Rules::kSumo && config.policy != Policy::kSumo && config.penetration >= 1.0) {
    if (!Has(given, kJunctionBlocker)) add(kJunctionBlocker, kBlockerTime);
    if (!Has(given, kImpatience)) add(kImpatience, kImpatienceTime);
  }
  add("step-length", fmt::format("{}", config.step_length));
  add("seed", fmt::format("{}", config.seed));
  if (config.end) add("end", fmt::format("{}", *config.end));
  line.insert(line.end(), config.sumo_options.begin(), config.sumo_options.end());
  return line;
}

std::vector<std::string> RepeatArguments(const RunConfig& config) {
  std::vector<std::string> arguments;
  const auto add = [&](const char* option, std::string value) {
    arguments.emplace_back(option);
    arguments.push_back(std::move(value));
  };
  const auto absolute = [](const std::string& list) {
    std::vector<std::string> files;
    for (const fs::path& file : SplitFiles(list, "")) files.push_back(fs::absolute(file).string());
    return fmt::format("{}", fmt::join(files, ","));
  };
  if (!config.config_file.empty()) {
    add("--configuration-file", fs::absolute(config.config_file).string());
  } else {
    add("--net-file", fs::absolute(config.net_file).string());
    add("--route-files", absolute(config.route_files));
    if (!config.additional_files.empty()) add("--additional-files", absolute(config.additional_files));
  }
  add("--policy", std::string(kPolicyNames[static_cast<std::size_t>(config.policy)]));
  add("--penetration", fmt::format("{}", config.penetration));
  add("--rules", std::string(kRulesNames[static_cast<std::size_t>(config.rules)]));
  add("--v2x", std::string(kV2xLevelNames[static_cast<std::size_t>(config.v2x)]));
  add("--coordinate", CoordinationText(config.coordinate));
  add("--seed", fmt::format("{}", config.seed));
  if (config.end) add("--end", fmt::format("{}", *config.end));
  add("--step-length", fmt::format("{}", config.step_length));
  add("--sample-period", fmt::format("{}", config.sample_period));
  add("--safety", std::string(kSafetyLevelNames[static_cast<std::size_t>(config.safety_level)]));
  add("--edge-interval", fmt::format("{}", config.edge_interval));
  const std::vector<std::string> sumo = RepeatSumoOptions(config.sumo_options);
  if (!sumo.empty()) arguments.emplace_back("--");
  arguments.insert(arguments.end(), sumo.begin(), sumo.end());
  return arguments;
}

namespace {

void LoadTable(const toml::table& table, const std::string& prefix, const std::string& file,
               RunParams* params) {
  for (const auto& [key, node] : table) {
    const std::string name = prefix.empty() ? std::string(key.str()) : prefix + "." + std::string(key.str());
    const std::string origin = fmt::format("{}, line {}", file, node.source().begin.line);
    if (const toml::table* nested = node.as_table()) {
      LoadTable(*nested, name, file, params);
    } else if (const auto number = node.value<double>(); number && !node.is_boolean()) {
      SetParam(params, name, *number, origin);
    } else {
      throw ConfigError(fmt::format("{}: parameter '{}' is no number", origin, name));
    }
  }
}

}  // namespace

SafetyLevel ParseSafetyLevel(std::string_view name) {
  for (std::size_t i = 0; i < std::size(kSafetyLevelNames); ++i) {
    if (kSafetyLevelNames[i] == name) return static_cast<SafetyLevel>(i);
  }
  throw ConfigError(
      fmt::format("--safety: unknown value '{}'; allowed: {}", name, fmt::join(kSafetyLevelNames, ", ")));
}

void LoadParams(const fs::path& file, RunParams* params) {
  if (!fs::exists(file)) throw ConfigError(fmt::format("{}: no such file", file.string()));
  try {
    LoadTable(toml::parse_file(file.string()), "", file.string(), params);
  } catch (const toml::parse_error& error) {
    throw ConfigError(fmt::format("{}, line {}: broken TOML: {}", file.string(), error.source().begin.line,
                                  error.description()));
  }
}

void SetParamFromText(const std::string& assignment, RunParams* params) {
  const std::size_t equals = assignment.find('=');
  if (equals == std::string::npos) {
    throw ConfigError(fmt::format(
        "--set: '{}' is no assignment; allowed: name=value, e.g. dwa.clearance_weight=1.5", assignment));
  }
  const std::string text = assignment.substr(equals + 1);
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) {
    throw ConfigError(fmt::format("--set: '{}' is no number in '{}'", text, assignment));
  }
  SetParam(params, assignment.substr(0, equals), value, "--set");
}

}  // namespace lanewise
