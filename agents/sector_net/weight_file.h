#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "agents/sector_net/bls_net.h"
#include "agents/sector_net/bp_net.h"

namespace lanewise {

/// Where a network's weights come from; kept in its file.
struct TrainingRecord {
  std::string method;   ///< E.g. "gradient descent".
  std::string samples;  ///< File, or "generated".
  std::int64_t training_samples{0};
  std::int64_t test_samples{0};
  std::uint64_t seed{0};
  std::int64_t epochs{0};
  double training_error{0.0};  ///< [-] mean squared error.
  std::int64_t test_correct{0};
  std::string program;  ///< Version of Lanewise.
};

// Weight files are JSON: format, version, kind ("bp" or "bls"), shape, input_scale, training, weights and,
// over all that, a checksum (XXH3 of the text without it). Numbers are written so that they read back bit for
// bit.

/// Writes the file whole or not at all. @throws ConfigError if it cannot be written.
void SaveWeights(const std::filesystem::path& file, const BpNet& net, const TrainingRecord& training);
void SaveWeights(const std::filesystem::path& file, const BlsNet& net, const TrainingRecord& training);

/// @throws ConfigError naming the file and what is wrong: no such file, not JSON (with line), no weight file,
/// of another kind or shape, damaged (checksum), a weight that is no number.
BpNet LoadBpNet(const std::filesystem::path& file, TrainingRecord* training = nullptr);
BlsNet LoadBlsNet(const std::filesystem::path& file, TrainingRecord* training = nullptr);
/// The same of a text. @param origin what messages call it.
BpNet ParseBpNet(std::string_view text, std::string_view origin, TrainingRecord* training = nullptr);
BlsNet ParseBlsNet(std::string_view text, std::string_view origin, TrainingRecord* training = nullptr);

/// The networks shipped with Lanewise, compiled in: agents/sector_net/default_*.json, made with
/// `lanewise train bp` and `lanewise train bls --simplify 1e-9`.
const BpNet& DefaultBpNet();
const BlsNet& DefaultBlsNet();

}  // namespace lanewise
