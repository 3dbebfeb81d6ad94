#include "scenarios/run_config.h"

#include <fmt/ranges.h>

#include <toml++/toml.h>
#include <algorithm>
#include <charconv>
#include <cstdlib>
#include <pugixml.hpp>
#include <set>

namespace lanewise {
namespace {

namespace fs = std::filesystem;

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

/// Names of the options in a list of command-line arguments.
std::vector<std::string> OptionNames(const std::vector<std::string>& arguments) {
  std::vector<std::string> names;
  for (const std::string& argument : arguments) {
    if (!argument.starts_with("-") || argument.size() < 2 || (argument[1] >= '0' && argument[1] <= '9'))
      continue;
    const std::size_t start = argument.find_first_not_of('-');
    if (start == std::string::npos) continue;
    names.emplace_back(LongName(argument.substr(start, argument.find('=') - start)));
  }
  return names;
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
  if (!config.config_file.empty()) {
    auto files = ReadSumoConfig(config.config_file).inputs;
    files.insert(files.begin(), config.config_file);
    return files;
  }
  std::vector<fs::path> files{config.net_file};
  for (const std::string* list : {&config.route_files, &config.additional_files}) {
    const auto more = SplitFiles(*list, "");
    files.insert(files.end(), more.begin(), more.end());
  }
  return files;
}

std::vector<std::string> SumoCommandLine(const RunConfig& config) {
  std::vector<std::string> line;
  std::vector<std::string> given = OptionNames(config.sumo_options);
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
  add("--seed", fmt::format("{}", config.seed));
  if (config.end) add("--end", fmt::format("{}", *config.end));
  add("--step-length", fmt::format("{}", config.step_length));
  add("--sample-period", fmt::format("{}", config.sample_period));
  add("--safety", std::string(kSafetyLevelNames[static_cast<std::size_t>(config.safety_level)]));
  add("--edge-interval", fmt::format("{}", config.edge_interval));
  if (!config.sumo_options.empty()) arguments.emplace_back("--");
  arguments.insert(arguments.end(), config.sumo_options.begin(), config.sumo_options.end());
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
