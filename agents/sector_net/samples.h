#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string_view>
#include <vector>

#include "agents/sector_net/sector_io.h"

namespace lanewise {

/// What a sensor saw and where a driver then went.
struct LabelledScan {
  SectorInputs sectors{};
  Avoidance way{Avoidance::kForward};
  double weight{1.0};  ///< Number of equal samples this one stands for; > 0.
};

// clang-format off
// Sample files are CSV. Lines that begin with # are comments. The first other line names the columns, in any
// order, and no others:
//
//   column                          unit  meaning
//   sector_0_free .. sector_7_free  [-]   1 = free, 0 = obstacle (Eq. 8 of [A]), in [0, 1]; 0 is the left one
//   left, forward, right            [-]   the way taken: a unit vector, one 1 and two 0
//   time_s                          [s]   when; optional, not used in training
//   vehicle                         -     who; optional, not used in training
// clang-format on

/// Reads a sample file. @throws ConfigError naming file, line and column, what was found and what is allowed:
/// wrong or missing columns, a value that is no number or out of range, a label that is no unit vector, no
/// samples.
std::vector<LabelledScan> LoadSamples(const std::filesystem::path& file);
/// The same of a text. @param origin what messages call it.
std::vector<LabelledScan> ParseSamples(std::string_view text, std::string_view origin);

/// Writes a sample file row by row.
class SampleWriter {
 public:
  /// @throws ConfigError if the file cannot be created.
  /// @param note a line about where the samples come from; it becomes a comment.
  explicit SampleWriter(const std::filesystem::path& file, std::string_view note = {});
  void Add(double time, std::string_view vehicle, const SectorInputs& sectors, Avoidance way);
  /// @throws ConfigError if not everything could be written.
  void Finish();
  std::int64_t count() const { return count_; }

 private:
  std::filesystem::path file_;
  std::ofstream out_;
  std::int64_t count_{0};
};

/// The labelling rule of generated samples: forward if both sectors ahead (3 and 4, 45 deg together) are
/// free; else to the side with more free sectors; if both have the same number, to the left, where vehicles
/// that keep right overtake. Nothing free (code 0) has no way to go: policies brake there and never ask.
/// @param code > 0; bit i is sector i, 1 free.
Avoidance WayByRule(std::uint8_t code);

/// The 255 codes that have a way to go, labelled by the rule.
std::vector<LabelledScan> GeneratedSamples();

/// Part of the samples to train with, and part held out.
struct SampleSplit {
  std::vector<LabelledScan> training, test;
};

/// Draws without putting back; a function of the samples and the seed.
/// @throws ConfigError if there are fewer than training + test samples.
SampleSplit SplitSamples(std::vector<LabelledScan> samples, std::size_t training, std::size_t test,
                         std::uint64_t seed);

/// Equal samples as one with the sum of their weights, in order of their first occurrence. Training on them
/// is the same as on all of them.
std::vector<LabelledScan> MergeEqual(const std::vector<LabelledScan>& samples);

/// Weighs samples so that each way that occurs has the same sum: else a network learns to go forward always,
/// as most traffic does. The sum of all weights is kept.
void BalanceWays(std::vector<LabelledScan>* samples);

/// Samples of `test` whose inputs also occur in `training`: those are not held out in truth.
std::size_t CountSeen(const SampleSplit& split);

}  // namespace lanewise
