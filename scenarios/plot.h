#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace lanewise {

struct PlotLine {
  std::string title;
  std::vector<double> x, y;  ///< Of equal length.
  bool dashed{false};
};

/// One diagram; several are drawn below each other.
struct PlotPanel {
  std::string title, x_label, y_label;  ///< Labels with units.
  bool log_x{false}, log_y{false};      ///< Values that are not positive are then left out.
  std::vector<PlotLine> lines;
};

/// Draws with gnuplot, which is started for it; the file's ending says how: .svg, .png or .pdf. The file is
/// written whole or not at all. @throws ConfigError: another ending, no gnuplot, or not writable.
void DrawPlot(const std::filesystem::path& file, std::span<const PlotPanel> panels);

/// Refuses an output file before work begins: it exists and is not to be replaced, its folder does not exist,
/// it is a folder. @throws ConfigError naming the option that is wrong.
void CheckOutputFile(const char* option, const std::filesystem::path& file, bool replace);
/// The same for DrawPlot's file, with its ending.
void CheckPlotFile(const char* option, const std::filesystem::path& file, bool replace);
/// Writes a text file whole or not at all. @throws ConfigError.
void WriteTextFile(const std::filesystem::path& file, const std::string& text);

}  // namespace lanewise
