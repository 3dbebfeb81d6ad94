#include "analysis/comparison_format.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "agents/core/check.h"

namespace lanewise {
namespace {

using Json = nlohmann::ordered_json;
using Line = std::vector<std::string>;

constexpr const char* kFormatNames[] = {"text", "md", "csv", "json", "latex"};

/// Decimals that show two digits of `uncertainty`, or four of `value` if there is none.
int Decimals(double uncertainty, double value) {
  const double scale = uncertainty > 0.0 ? uncertainty * 10.0 : std::abs(value) / 100.0 * 10.0;
  if (!(scale > 0.0)) return 0;
  return std::clamp(2 - static_cast<int>(std::floor(std::log10(scale))), 0, 6);
}

int DecimalsOf(const MetricComparison& m) {
  return Decimals(0.5 * (m.difference.interval.high - m.difference.interval.low),
                  std::max(std::abs(m.baseline_mean), std::abs(m.policy_mean)));
}

std::string Number(double value, int decimals, bool sign = false) {
  std::string text =
      sign ? fmt::format("{:+.{}f}", value, decimals) : fmt::format("{:.{}f}", value, decimals);
  // -0.0 is no difference.
  if (text.find_first_not_of("+-0.") == std::string::npos) text.erase(0, text.find_first_not_of("+-"));
  return text;
}

std::string PText(const MetricComparison& m) {
  if (m.difference.count < 2) return "-";
  return m.p_holm < 0.001 ? "<0.001" : fmt::format("{:.3f}", m.p_holm);
}

std::string RelativeText(const MetricComparison& m) {
  if (m.baseline_mean == 0.0 || m.difference.count == 0) return "-";
  return Number(100.0 * m.difference.mean / std::abs(m.baseline_mean), 1, true) + " %";
}

std::string IntervalText(const MeanEstimate& estimate, int decimals, bool sign) {
  if (estimate.kind == IntervalKind::kNone) return "-";
  return fmt::format("[{}, {}]", Number(estimate.interval.low, decimals, sign),
                     Number(estimate.interval.high, decimals, sign));
}

const char* VerdictName(Verdict verdict) {
  switch (verdict) {
    case Verdict::kNothing:
      return "no test";
    case Verdict::kIdentical:
      return "identical";
    case Verdict::kLower:
      return "lower";
    case Verdict::kHigher:
      return "higher";
    case Verdict::kIrrelevant:
      return "no relevant difference";
    case Verdict::kOpen:
      return "open";
  }
  return "";
}

std::string VerdictText(const MetricComparison& m) {
  const Better better = AllMetrics()[m.metric].better;
  std::string text = VerdictName(m.verdict);
  if (m.verdict == Verdict::kLower || m.verdict == Verdict::kHigher) {
    if (better == Better::kNeither) return text;
    return (m.verdict == Verdict::kLower) == (better == Better::kLower) ? "better" : "WORSE";
  }
  if (m.verdict == Verdict::kOpen)
    text += m.seeds_needed ? fmt::format(": {} seeds", *m.seeds_needed) : ": above 1e6 seeds";
  return text;
}

/// Characters on the screen of UTF-8 text.
std::size_t Width(const std::string& text) {
  return static_cast<std::size_t>(std::count_if(
      text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; }));
}

/// Columns aligned: those in `left` to the left, the others to the right; a rule below the first line.
std::string Align(const std::vector<Line>& lines, std::initializer_list<std::size_t> left) {
  std::vector<std::size_t> width;
  for (const Line& line : lines) {
    width.resize(std::max(width.size(), line.size()));
    for (std::size_t k = 0; k < line.size(); ++k) width[k] = std::max(width[k], Width(line[k]));
  }
  std::string text;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    std::string row;
    for (std::size_t k = 0; k < lines[i].size(); ++k) {
      const std::string pad(width[k] - Width(lines[i][k]), ' ');
      const bool to_left = std::find(left.begin(), left.end(), k) != left.end();
      if (k > 0) row += "  ";
      row += to_left ? lines[i][k] : pad;
      row += to_left ? pad : lines[i][k];
    }
    row.erase(row.find_last_not_of(' ') + 1);
    text += row;
    text += '\n';
    if (i == 0) {
      std::size_t total = 2 * (width.size() - 1);
      for (const std::size_t w : width) total += w;
      text.append(total, '-');
      text += '\n';
    }
  }
  return text;
}

std::string Percent(double level) {
  return fmt::format("{:g} %", 100.0 * level);
}

Line Header(const ScenarioComparison& s, const PolicyComparison& policy, const CompareParams& params) {
  return {"metric",     s.baseline, policy.policy,
          "difference", "relative", Percent(1.0 - params.statistics.alpha) + " interval",
          "p (Holm)",   "g",        "pairs",
          "verdict"};
}

Line Cells(const MetricComparison& m) {
  const int decimals = DecimalsOf(m);
  return {AllMetrics()[m.metric].label,
          Number(m.baseline_mean, decimals),
          Number(m.policy_mean, decimals),
          Number(m.difference.mean, decimals, true),
          RelativeText(m),
          IntervalText(m.difference, decimals, true),
          PText(m),
          m.effect_size ? Number(*m.effect_size, 2, true) : "-",
          fmt::format("{}", m.difference.count),
          VerdictText(m)};
}

std::string ShareText(const PolicySummary& s) {
  if (std::abs(s.max_agent_share - s.min_agent_share) < 5e-4)
    return fmt::format("{:.1f} %", 100.0 * s.max_agent_share);
  return fmt::format("{:.1f} to {:.1f} %", 100.0 * s.min_agent_share, 100.0 * s.max_agent_share);
}

std::vector<Line> WhoDrove(const ScenarioComparison& s) {
  std::vector<Line> lines{
      {"policy", "runs", "agents' share", "inserted", "not inserted", "still driving", "teleports"}};
  for (const PolicySummary& p : s.summaries) {
    lines.push_back({p.policy, fmt::format("{}", p.runs), ShareText(p), fmt::format("{}", p.inserted),
                     fmt::format("{}", p.not_inserted), fmt::format("{}", p.still_running),
                     fmt::format("{}", p.teleported)});
  }
  return lines;
}

/// Means of each policy alone, for scenarios without a pair.
std::vector<Line> Means(const ScenarioComparison& s) {
  std::vector<Line> lines{{"metric"}};
  for (const PolicySummary& p : s.summaries) {
    lines[0].push_back(p.policy);
    lines[0].push_back("interval");
  }
  for (std::size_t m = 0; m < s.metrics.size(); ++m) {
    Line& line = lines.emplace_back(Line{AllMetrics()[s.metrics[m]].label});
    for (const PolicySummary& p : s.summaries) {
      const MeanEstimate& e = p.metrics[m];
      const int decimals = Decimals(0.5 * (e.interval.high - e.interval.low), e.mean);
      line.push_back(e.count == 0 ? "-" : Number(e.mean, decimals));
      line.push_back(IntervalText(e, decimals, false));
    }
  }
  return lines;
}

std::string Method(const Comparison& c) {
  const StatisticsParams& s = c.params.statistics;
  return fmt::format(
      "Pairs share scenario, seed{}. Differences: policy minus baseline, mean over pairs. Intervals: "
      "expanded BCa "
      "bootstrap of {} resamples (Student's t below 6 pairs). p: {} test, two-sided, adjusted by Holm over "
      "all "
      "comparisons of the scenario. g: Hedges' effect size of the paired differences. Open: the pairs with "
      "which a "
      "t test at Holm's first step finds the difference seen, or {} of the baseline if that is more, with {} "
      "power.",
      c.params.ignore_demand ? " (demand ignored)" : " and demand", s.resamples,
      s.test == SignificanceTest::kWilcoxon ? "Wilcoxon signed-rank" : "sign-flip permutation",
      Percent(c.params.smallest_effect), Percent(c.params.power));
}

std::string Wrap(const std::string& text, const std::string& indent, std::size_t width) {
  std::string out, line = indent;
  std::size_t from = 0;
  while (from < text.size()) {
    std::size_t to = text.find(' ', from);
    if (to == std::string::npos) to = text.size();
    const std::string word = text.substr(from, to - from);
    if (Width(line) + Width(word) + 1 > width && line.size() > indent.size()) {
      out += line + '\n';
      line = std::string(indent.size(), ' ');
    }
    if (line.size() > indent.size()) line += ' ';
    line += word;
    from = to + 1;
  }
  return out + line + '\n';
}

std::string FormatText(const Comparison& c) {
  constexpr std::size_t kWidth = 118;
  std::string text;
  for (const ScenarioComparison& s : c.scenarios) {
    text += fmt::format("{}scenario {}{}, {} in the family\n\n", s.partial ? "PARTIAL: " : "", s.scenario,
                        s.baseline.empty() ? "" : ", baseline " + s.baseline,
                        s.family == 1 ? "1 comparison" : fmt::format("{} comparisons", s.family));
    text += Align(WhoDrove(s), {0}) + '\n';
    for (const PolicyComparison& policy : s.policies) {
      std::vector<Line> lines{Header(s, policy, c.params)};
      for (const MetricComparison& m : policy.metrics) lines.push_back(Cells(m));
      text += Align(lines, {0, 9}) + '\n';
    }
    if (s.policies.empty() && !s.summaries.empty())
      text +=
          "means over each policy's own runs (no pairs, so no comparison)\n" + Align(Means(s), {0}) + '\n';
    for (const std::string& note : s.notes) text += Wrap(note, "! ", kWidth);
    if (!s.notes.empty()) text += '\n';
  }
  return text + (c.any_pair() ? Wrap(Method(c), "", kWidth) : "");
}

std::string EscapeMarkdown(std::string text) {
  for (std::size_t at = 0; (at = text.find('|', at)) != std::string::npos; at += 2) text.insert(at, "\\");
  return text;
}

std::string MarkdownTable(const std::vector<Line>& lines) {
  std::string text;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    text += '|';
    for (const std::string& cell : lines[i]) text += fmt::format(" {} |", EscapeMarkdown(cell));
    text += '\n';
    if (i > 0) continue;
    text += '|';
    for (std::size_t k = 0; k < lines[0].size(); ++k) text += k == 0 ? "---|" : "--:|";
    text += '\n';
  }
  return text + '\n';
}

std::string FormatMarkdown(const Comparison& c) {
  std::string text;
  for (const ScenarioComparison& s : c.scenarios) {
    text += fmt::format("## {}{}\n\n", s.scenario, s.partial ? " (partial)" : "");
    text += MarkdownTable(WhoDrove(s));
    for (const PolicyComparison& policy : s.policies) {
      std::vector<Line> lines{Header(s, policy, c.params)};
      for (const MetricComparison& m : policy.metrics) lines.push_back(Cells(m));
      text += MarkdownTable(lines);
    }
    if (s.policies.empty() && !s.summaries.empty()) text += MarkdownTable(Means(s));
    for (const std::string& note : s.notes) text += fmt::format("- {}\n", note);
    if (!s.notes.empty()) text += '\n';
  }
  return text + (c.any_pair() ? Method(c) + '\n' : "");
}

std::string EscapeLatex(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (std::string_view("%_#&${}").find(c) != std::string_view::npos) {
      out += '\\';
      out += c;
    } else if (c == '^') {
      out += "\\textasciicircum{}";
    } else if (c == '<') {
      out += "$<$";
    } else {
      out += c;
    }
  }
  return out;
}

std::string LatexTable(const std::vector<Line>& lines, const std::string& caption) {
  std::string text = "\\begin{table}\n  \\centering\\footnotesize\\setlength{\\tabcolsep}{3pt}\n";
  text += fmt::format("  \\caption{{{}}}\n  \\begin{{tabular}}{{l{}}}\n    \\toprule\n", EscapeLatex(caption),
                      std::string(lines[0].size() - 1, 'r'));
  for (std::size_t i = 0; i < lines.size(); ++i) {
    Line cells;
    for (const std::string& cell : lines[i]) {
      const bool number = !cell.empty() && (cell[0] == '-' || cell[0] == '+') && cell.size() > 1;
      // A minus sign, not a hyphen; a bracket after \\ would be read as its argument, so rows are kept in
      // braces.
      cells.push_back(number ? fmt::format("${}$", EscapeLatex(cell))
                             : fmt::format("{{{}}}", EscapeLatex(cell)));
    }
    text += fmt::format("    {} \\\\\n", fmt::join(cells, " & "));
    if (i == 0) text += "    \\midrule\n";
  }
  return text + "    \\bottomrule\n  \\end{tabular}\n\\end{table}\n\n";
}

std::string FormatLatex(const Comparison& c) {
  std::string text =
      "% Needs \\usepackage{booktabs}; as wide as a page in landscape (pdflscape) or as two columns "
      "(table*).\n";
  for (const ScenarioComparison& s : c.scenarios) {
    const std::string partial = s.partial ? " (partial)" : "";
    for (const PolicyComparison& policy : s.policies) {
      std::vector<Line> lines{Header(s, policy, c.params)};
      for (const MetricComparison& m : policy.metrics) lines.push_back(Cells(m));
      text += LatexTable(lines,
                         fmt::format("{}: {} against {}{}", s.scenario, policy.policy, s.baseline, partial));
    }
    if (s.policies.empty() && !s.summaries.empty())
      text += LatexTable(Means(s), fmt::format("{}: means without pairs{}", s.scenario, partial));
    for (const std::string& note : s.notes) text += fmt::format("% {}\n", note);
  }
  return text + (c.any_pair() ? fmt::format("% {}\n", Method(c)) : "");
}

std::string CsvField(const std::string& text) {
  if (text.find_first_of(",\"\n") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + '"';
}

/// Full precision; empty where there is nothing.
std::string CsvNumber(std::optional<double> value) {
  return value ? fmt::format("{}", *value) : "";
}

std::string FormatCsv(const Comparison& c) {
  std::string text =
      "scenario,baseline,policy,metric,pairs,baseline_mean,policy_mean,difference,deviation,interval_low,"
      "interval_high,interval_kind,p,p_exact,p_holm,effect_size_g,verdict,seeds_needed,partial\n";
  for (const ScenarioComparison& s : c.scenarios) {
    for (const PolicyComparison& policy : s.policies) {
      for (const MetricComparison& m : policy.metrics) {
        const MeanEstimate& d = m.difference;
        const bool tested = d.count >= 2;
        const auto if_tested = [&](double value) {
          return CsvNumber(tested ? std::optional(value) : std::nullopt);
        };
        const Line cells{CsvField(s.scenario),
                         CsvField(s.baseline),
                         CsvField(policy.policy),
                         AllMetrics()[m.metric].name,
                         fmt::format("{}", d.count),
                         CsvNumber(m.baseline_mean),
                         CsvNumber(m.policy_mean),
                         CsvNumber(d.mean),
                         if_tested(d.deviation),
                         if_tested(d.interval.low),
                         if_tested(d.interval.high),
                         ToString(d.kind),
                         if_tested(m.p.p),
                         fmt::format("{:d}", m.p.exact),
                         if_tested(m.p_holm),
                         CsvNumber(m.effect_size),
                         VerdictName(m.verdict),
                         m.seeds_needed ? fmt::format("{}", *m.seeds_needed) : "",
                         fmt::format("{:d}", s.partial)};
        text += fmt::format("{}\n", fmt::join(cells, ","));
      }
    }
  }
  return text;
}

Json ToJson(const MeanEstimate& e) {
  Json json{{"count", e.count}, {"mean", nullptr}, {"deviation", nullptr}, {"interval", nullptr}};
  json["interval_kind"] = ToString(e.kind);
  if (e.count > 0) json["mean"] = e.mean;
  if (e.count > 1) {
    json["deviation"] = e.deviation;
    json["interval"] = {e.interval.low, e.interval.high};
  }
  return json;
}

Json ToJson(const MetricComparison& m) {
  Json json{{"metric", AllMetrics()[m.metric].name},
            {"label", AllMetrics()[m.metric].label},
            {"baseline_mean", m.baseline_mean},
            {"policy_mean", m.policy_mean},
            {"difference", ToJson(m.difference)}};
  const bool tested = m.difference.count >= 2;
  json["p"] = tested ? Json(m.p.p) : Json();
  json["p_exact"] = m.p.exact;
  json["p_holm"] = tested ? Json(m.p_holm) : Json();
  json["effect_size_g"] = m.effect_size ? Json(*m.effect_size) : Json();
  json["verdict"] = VerdictName(m.verdict);
  json["seeds_needed"] = m.seeds_needed ? Json(*m.seeds_needed) : Json();
  return json;
}

std::string FormatJson(const Comparison& c) {
  Json root{{"partial", c.partial()},
            {"runs", c.runs},
            {"alpha", c.params.statistics.alpha},
            {"test", ToString(c.params.statistics.test)},
            {"resamples", c.params.statistics.resamples},
            {"bootstrap_seed", c.params.statistics.seed},
            {"smallest_effect", c.params.smallest_effect},
            {"power", c.params.power},
            {"scenarios", Json::array()}};
  for (const ScenarioComparison& s : c.scenarios) {
    Json scenario{
        {"scenario", s.scenario}, {"baseline", s.baseline}, {"partial", s.partial}, {"family", s.family}};
    scenario["policies"] = Json::array();
    for (const PolicySummary& p : s.summaries) {
      Json summary{{"policy", p.policy},
                   {"runs", p.runs},
                   {"agent_share", {p.min_agent_share, p.max_agent_share}},
                   {"inserted", p.inserted},
                   {"not_inserted", p.not_inserted},
                   {"still_running", p.still_running},
                   {"teleported", p.teleported}};
      for (std::size_t m = 0; m < s.metrics.size(); ++m)
        summary["metrics"][AllMetrics()[s.metrics[m]].name] = ToJson(p.metrics[m]);
      scenario["policies"].push_back(std::move(summary));
    }
    scenario["comparisons"] = Json::array();
    for (const PolicyComparison& p : s.policies) {
      Json policy{{"policy", p.policy}, {"pairs", p.pairs}, {"metrics", Json::array()}};
      for (const MetricComparison& m : p.metrics) policy["metrics"].push_back(ToJson(m));
      scenario["comparisons"].push_back(std::move(policy));
    }
    scenario["notes"] = s.notes;
    root["scenarios"].push_back(std::move(scenario));
  }
  return root.dump(2, ' ', false, Json::error_handler_t::replace) + '\n';
}

}  // namespace

TableFormat ParseTableFormat(const std::string& name, const std::string& origin) {
  for (std::size_t i = 0; i < std::size(kFormatNames); ++i) {
    if (name == kFormatNames[i]) return static_cast<TableFormat>(i);
  }
  throw ConfigError(
      fmt::format("{}: unknown value '{}'; allowed: {}", origin, name, fmt::join(kFormatNames, ", ")));
}

std::string FormatComparison(const Comparison& comparison, TableFormat format) {
  switch (format) {
    case TableFormat::kText:
      return FormatText(comparison);
    case TableFormat::kMarkdown:
      return FormatMarkdown(comparison);
    case TableFormat::kCsv:
      return FormatCsv(comparison);
    case TableFormat::kJson:
      return FormatJson(comparison);
    case TableFormat::kLatex:
      return FormatLatex(comparison);
  }
  return "";
}

std::string FormatAaResults(std::span<const AaResult> results, bool against) {
  std::string text;
  for (const AaResult& r : results) {
    text += fmt::format("scenario {}, {}: {} repetitions of {} pairs drawn from {} recorded {}\n", r.scenario,
                        r.policy, r.repetitions, r.pairs, r.runs, against ? "pairs" : "runs");
    std::vector<Line> lines{{"metric", "intervals", "hold the truth", "coverage"}};
    std::size_t intervals = 0, covered = 0;
    const auto percent = [](std::size_t part, std::size_t whole) {
      return whole == 0
                 ? "-"
                 : fmt::format("{:.1f} %", 100.0 * static_cast<double>(part) / static_cast<double>(whole));
    };
    for (const AaResult::Coverage& c : r.coverage) {
      lines.push_back({AllMetrics()[c.metric].label, fmt::format("{}", c.intervals),
                       fmt::format("{}", c.covered), percent(c.covered, c.intervals)});
      intervals += c.intervals;
      covered += c.covered;
    }
    lines.push_back(
        {"all", fmt::format("{}", intervals), fmt::format("{}", covered), percent(covered, intervals)});
    text += Align(lines, {0});
    if (!against)
      text += fmt::format(
          "called significant after Holm: {} of {} comparisons ({}); in {} of {} repetitions ({})\n",
          r.significant, r.comparisons, percent(r.significant, r.comparisons), r.families_with_alarm,
          r.repetitions, percent(r.families_with_alarm, r.repetitions));
    text += '\n';
  }
  return text;
}

}  // namespace lanewise
