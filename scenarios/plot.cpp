#include "scenarios/plot.h"

#include <fmt/core.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <fstream>

#include "agents/core/check.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

constexpr int kWidth = 900, kHeight = 480;  // [px] of a panel.

std::string Terminal(const fs::path& file, std::size_t panels) {
  const int height = kHeight * static_cast<int>(panels);
  if (file.extension() == ".svg")
    return fmt::format("svg size {},{} font 'sans,14' background 'white' noenhanced", kWidth, height);
  if (file.extension() == ".png")
    return fmt::format("pngcairo size {},{} font 'sans,11' noenhanced", kWidth, height);
  if (file.extension() == ".pdf")
    return fmt::format("pdfcairo size {}cm,{}cm font 'sans,10' noenhanced", 18,
                       9.6 * static_cast<double>(panels));
  throw ConfigError(fmt::format("{}: plots are written as .svg, .png or .pdf", file.string()));
}

/// In gnuplot's double quotes.
std::string Quoted(const std::string& text) {
  std::string quoted{'"'};
  for (const char c : text) {
    if (c == '"' || c == '\\') quoted += '\\';
    quoted += c == '\n' ? ' ' : c;
  }
  return quoted + '"';
}

std::string Script(const fs::path& file, std::span<const PlotPanel> panels, const std::string& terminal) {
  std::string script = fmt::format(
      "set terminal {}\nset output {}\nset multiplot layout {},1\nset grid\nset key outside right top\n",
      terminal, Quoted(file.string()), panels.size());
  for (const PlotPanel& panel : panels) {
    script += fmt::format("set title {}\nset xlabel {}\nset ylabel {}\n", Quoted(panel.title),
                          Quoted(panel.x_label), Quoted(panel.y_label));
    script += panel.log_x ? "set logscale x\n" : "unset logscale x\n";
    script += panel.log_y ? "set logscale y\nset format y \"%g\"\n" : "unset logscale y\n";
    for (std::size_t k = 0; k < panel.lines.size(); ++k) {
      script +=
          fmt::format("{} '-' using 1:2 with lines linewidth 2 dashtype {} title {}", k == 0 ? "plot" : ",",
                      panel.lines[k].dashed ? 2 : 1, Quoted(panel.lines[k].title));
    }
    script += '\n';
    for (const PlotLine& line : panel.lines) {
      for (std::size_t i = 0; i < line.x.size(); ++i) {
        if ((panel.log_x && line.x[i] <= 0.0) || (panel.log_y && line.y[i] <= 0.0)) continue;
        script += fmt::format("{} {}\n", line.x[i], line.y[i]);
      }
      script += "e\n";
    }
  }
  return script + "unset multiplot\n";
}

}  // namespace

void DrawPlot(const fs::path& file, std::span<const PlotPanel> panels) {
  const fs::path part = fmt::format("{}.{}.part", file.string(), ::getpid());
  const std::string script = Script(part, panels, Terminal(file, panels.size()));
  // A gnuplot that ends early must not end this process too.
  const auto before = std::signal(SIGPIPE, SIG_IGN);
  std::FILE* gnuplot = ::popen("gnuplot 2>/dev/null", "w");
  bool drawn = gnuplot != nullptr;
  if (gnuplot != nullptr) {
    drawn = std::fwrite(script.data(), 1, script.size(), gnuplot) == script.size();
    drawn = ::pclose(gnuplot) == 0 && drawn;
  }
  std::signal(SIGPIPE, before);
  std::error_code error;
  if (drawn) fs::rename(part, file, error);
  if (!drawn || error) {
    fs::remove(part, error);
    throw ConfigError(fmt::format(
        "{}: could not be drawn; is gnuplot installed (Debian: gnuplot-nox) and the folder writable?",
        file.string()));
  }
}

void CheckOutputFile(const char* option, const fs::path& file, bool replace) {
  if (file.empty()) return;
  const fs::path folder = file.has_parent_path() ? file.parent_path() : fs::path(".");
  if (!fs::is_directory(folder))
    throw ConfigError(fmt::format("{}: {}: its folder does not exist", option, file.string()));
  if (fs::is_directory(file))
    throw ConfigError(fmt::format("{}: {}: it is a folder; name a file", option, file.string()));
  if (fs::exists(file) && !replace)
    throw ConfigError(fmt::format("{}: {}: it exists; --force replaces it", option, file.string()));
}

void CheckPlotFile(const char* option, const fs::path& file, bool replace) {
  if (file.empty()) return;
  CheckOutputFile(option, file, replace);
  Terminal(file, 1);
}

void WriteTextFile(const fs::path& file, const std::string& text) {
  const fs::path part = fmt::format("{}.{}.part", file.string(), ::getpid());
  std::ofstream out(part, std::ios::binary);
  out << text;
  out.close();
  std::error_code error;
  if (out) fs::rename(part, file, error);
  if (out && !error) return;
  fs::remove(part, error);
  throw ConfigError(fmt::format("{}: cannot be written", file.string()));
}

}  // namespace lanewise
