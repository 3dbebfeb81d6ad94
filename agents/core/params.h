#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "agents/core/check.h"

namespace lanewise {

/// Closed range of allowed values.
struct Range {
  double min;
  double max;
};

/// Visitor protocol: every parameter struct has
///   template <class Self, class Field> static void Visit(Self& self, Field&& field);
/// which calls field(name, value, unit, range, meaning, source) once per parameter. This one table
/// drives `--set`, `--config`, validation, the provenance in the results and the generated reference page.

/// One parameter as text, for `lanewise params` and the results' provenance.
struct ParamDescription {
  std::string name;
  std::string unit;
  double value;
  Range range;
  std::string meaning;
  std::string source;
};

template <class Params>
std::vector<ParamDescription> DescribeParams(const Params& params) {
  std::vector<ParamDescription> list;
  Params::Visit(params, [&](std::string_view name, auto& value, std::string_view unit, Range range,
                            std::string_view meaning, std::string_view source) {
    list.push_back({std::string(name), std::string(unit), static_cast<double>(value), range,
                    std::string(meaning), std::string(source)});
  });
  return list;
}

/// Number of single-character edits between two names; for "did you mean".
std::size_t EditDistance(std::string_view a, std::string_view b);

/// Sets one parameter by name.
/// @throws ConfigError naming `origin`, the parameter, what was found and what is allowed.
template <class Params>
void SetParam(Params* params, std::string_view name, double number, std::string_view origin) {
  bool found = false;
  std::string nearest;
  std::size_t nearest_distance = name.size();
  Params::Visit(*params, [&](std::string_view field, auto& value, std::string_view unit, Range range,
                             std::string_view, std::string_view) {
    const std::size_t distance = EditDistance(field, name);
    if (distance < nearest_distance) {
      nearest_distance = distance;
      nearest = field;
    }
    if (field != name) return;
    found = true;
    if (!(number >= range.min && number <= range.max)) {
      throw ConfigError(fmt::format("{}: parameter '{}' is {} {}; allowed: {} to {} {}", origin, name, number,
                                    unit, range.min, range.max, unit));
    }
    using Value = std::remove_reference_t<decltype(value)>;
    if (std::is_integral_v<Value> && number != static_cast<double>(static_cast<long long>(number))) {
      throw ConfigError(
          fmt::format("{}: parameter '{}' is {}; allowed: a whole number", origin, name, number));
    }
    value = static_cast<Value>(number);
  });
  if (!found) {
    throw ConfigError(fmt::format("{}: unknown parameter '{}'{}; `lanewise params` lists all", origin, name,
                                  nearest.empty() ? "" : fmt::format(" (did you mean '{}'?)", nearest)));
  }
}

}  // namespace lanewise
