#include "agents/sector_net/weight_file.h"

#include <fmt/core.h>
#include <unistd.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include <cmath>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <vector>

#include "agents/core/check.h"
#include "agents/sector_net/default_weights.h"

namespace lanewise {
namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kFormat = "lanewise sector network";
constexpr int kVersion = 1;

[[noreturn]] void Refuse(std::string_view origin, const std::string& reason) {
  throw ConfigError(fmt::format("{}: {}", origin, reason));
}

std::string Checksum(Json file) {
  file.erase("checksum");
  const std::string text = file.dump();
  return fmt::format("xxh3:{:016x}", XXH3_64bits(text.data(), text.size()));
}

Json Begin(const char* kind, const std::vector<int>& shape, InputScale scale, const TrainingRecord& t) {
  return {{"format", kFormat},
          {"version", kVersion},
          {"kind", kind},
          {"shape", shape},
          {"input_scale", {{"min", scale.min}, {"max", scale.max}}},
          {"training",
           {{"method", t.method},
            {"samples", t.samples},
            {"training_samples", t.training_samples},
            {"test_samples", t.test_samples},
            {"seed", t.seed},
            {"epochs", t.epochs},
            {"training_error", t.training_error},
            {"test_correct", t.test_correct},
            {"program", t.program}}}};
}

/// Matrices by columns.
template <class Matrix>
Json Numbers(const Matrix& matrix) {
  const Eigen::MatrixXd plain = matrix;
  return std::vector<double>(plain.data(), plain.data() + plain.size());
}

void Write(const std::filesystem::path& file, Json json) {
  json["checksum"] = Checksum(json);
  const std::filesystem::path partial = fmt::format("{}.{}.part", file.string(), ::getpid());
  std::ofstream out(partial);
  out << json.dump(1) << '\n';
  out.close();
  std::error_code error;
  if (out) std::filesystem::rename(partial, file, error);
  if (!out || error) {
    std::error_code ignored;
    std::filesystem::remove(partial, ignored);
    Refuse(file.string(), "cannot be written");
  }
}

/// A parsed and undamaged weight file.
class WeightFile {
 public:
  WeightFile(std::string_view text, std::string_view origin) : origin_(origin) {
    try {
      json_ = Json::parse(text);
    } catch (const Json::parse_error& error) {
      // "[json.exception.parse_error.101] parse error at line 3, column 5: ..."
      const std::string message = error.what();
      Refuse(origin, "broken JSON: " + message.substr(message.find("] ") + 2));
    }
    if (!json_.is_object() || Value("format", Json("")) != kFormat)
      Refuse(origin, fmt::format("no weight file; expected JSON with \"format\": \"{}\"", kFormat));
    if (Value("version", Json(0)) != kVersion)
      Refuse(origin, fmt::format("version is {}; allowed: {}", Value("version", Json(0)).dump(), kVersion));
    const std::string found = Value("checksum", Json("")).dump(), right = Json(Checksum(json_)).dump();
    if (found != right)
      Refuse(origin, fmt::format("damaged: checksum is {}, the content's is {}", found, right));
  }

  void CheckKind(const char* kind) const {
    if (Value("kind", Json("")) != kind)
      Refuse(origin_, fmt::format("kind is {}; allowed: \"{}\"", Value("kind", Json("")).dump(), kind));
  }
  std::vector<int> Shape() const { return Get<std::vector<int>>("shape"); }
  InputScale Scale() const {
    const InputScale scale{Get<double>("input_scale", "min"), Get<double>("input_scale", "max")};
    if (!std::isfinite(scale.min) || !std::isfinite(scale.max) || scale.max <= scale.min)
      Refuse(origin_, fmt::format("input_scale is {} to {}; allowed: min < max", scale.min, scale.max));
    return scale;
  }
  TrainingRecord Training() const {
    return {Get<std::string>("training", "method"),
            Get<std::string>("training", "samples"),
            Get<std::int64_t>("training", "training_samples"),
            Get<std::int64_t>("training", "test_samples"),
            Get<std::uint64_t>("training", "seed"),
            Get<std::int64_t>("training", "epochs"),
            Get<double>("training", "training_error"),
            Get<std::int64_t>("training", "test_correct"),
            Get<std::string>("training", "program")};
  }
  Eigen::MatrixXd Weights(const char* name, Eigen::Index rows, Eigen::Index columns) const {
    const auto numbers = Get<std::vector<double>>("weights", name);
    if (static_cast<Eigen::Index>(numbers.size()) != rows * columns) {
      Refuse(origin_, fmt::format("weights.{} has {} numbers; the shape asks for {}", name, numbers.size(),
                                  rows * columns));
    }
    for (const double number : numbers) {
      if (!std::isfinite(number))
        Refuse(origin_, fmt::format("weights.{}: {} is no finite number", name, number));
    }
    return Eigen::Map<const Eigen::MatrixXd>(numbers.data(), rows, columns);
  }

 private:
  Json Value(const char* name, Json otherwise) const { return json_.value(name, std::move(otherwise)); }

  template <class T, class... Names>
  T Get(Names... names) const {
    try {
      const Json* value = &json_;
      ((value = &value->at(names)), ...);
      return value->template get<T>();
    } catch (const Json::exception& error) {
      std::string path;
      ((path += path.empty() ? names : std::string(".") + names), ...);
      const std::string message = error.what();
      Refuse(origin_, fmt::format("{}: {}", path, message.substr(message.find("] ") + 2)));
    }
  }

  Json json_;
  std::string origin_;
};

std::string ReadText(const std::filesystem::path& file) {
  if (!std::filesystem::exists(file)) Refuse(file.string(), "no such file");
  std::ifstream in(file, std::ios::binary);
  if (std::filesystem::is_directory(file) || !in) Refuse(file.string(), "cannot be read");
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

void SaveWeights(const std::filesystem::path& file, const BpNet& net, const TrainingRecord& training) {
  Json json = Begin("bp", {kNetInputs, BpNet::kHidden, kNetOutputs}, net.scale, training);
  const auto part = [&](int begin, int end) { return Numbers(net.parameters.segment(begin, end - begin)); };
  json["weights"] = {{"hidden_weights", part(BpNet::kHiddenWeights, BpNet::kHiddenBiases)},
                     {"hidden_biases", part(BpNet::kHiddenBiases, BpNet::kOutputWeights)},
                     {"output_weights", part(BpNet::kOutputWeights, BpNet::kOutputBiases)},
                     {"output_biases", part(BpNet::kOutputBiases, BpNet::kParameters)}};
  Write(file, std::move(json));
}

void SaveWeights(const std::filesystem::path& file, const BlsNet& net, const TrainingRecord& training) {
  Json json =
      Begin("bls", {kNetInputs, net.features(), net.enhancements(), kNetOutputs}, net.scale, training);
  json["weights"] = {{"feature_weights", Numbers(net.feature_weights)},
                     {"feature_biases", Numbers(net.feature_biases)},
                     {"enhancement_weights", Numbers(net.enhancement_weights)},
                     {"enhancement_biases", Numbers(net.enhancement_biases)},
                     {"output_weights", Numbers(net.output_weights)}};
  Write(file, std::move(json));
}

BpNet ParseBpNet(std::string_view text, std::string_view origin, TrainingRecord* training) {
  const WeightFile file(text, origin);
  file.CheckKind("bp");
  const std::vector<int> shape = file.Shape();
  if (shape != std::vector<int>{kNetInputs, BpNet::kHidden, kNetOutputs})
    Refuse(origin, fmt::format("shape is {}; allowed: [{},{},{}]", Json(shape).dump(), kNetInputs,
                               BpNet::kHidden, kNetOutputs));
  BpNet net;
  net.scale = file.Scale();
  // In the file as in the parameters.
  const auto place = [&](int begin, const char* name, int rows, int columns) {
    net.parameters.segment(begin, rows * columns) = file.Weights(name, rows * columns, 1);
  };
  place(BpNet::kHiddenWeights, "hidden_weights", BpNet::kHidden, kNetInputs);
  place(BpNet::kHiddenBiases, "hidden_biases", BpNet::kHidden, 1);
  place(BpNet::kOutputWeights, "output_weights", kNetOutputs, BpNet::kHidden);
  place(BpNet::kOutputBiases, "output_biases", kNetOutputs, 1);
  if (training != nullptr) *training = file.Training();
  return net;
}

BlsNet ParseBlsNet(std::string_view text, std::string_view origin, TrainingRecord* training) {
  const WeightFile file(text, origin);
  file.CheckKind("bls");
  const std::vector<int> shape = file.Shape();
  if (shape.size() != 4 || shape[0] != kNetInputs || shape[3] != kNetOutputs || shape[1] < 1 ||
      shape[2] < 0 || shape[1] > BlsNet::kMaxNodes || shape[2] > BlsNet::kMaxNodes) {
    Refuse(origin,
           fmt::format("shape is {}; allowed: [{}, 1 to {} feature nodes, 0 to {} enhancement nodes, {}]",
                       Json(shape).dump(), kNetInputs, BlsNet::kMaxNodes, BlsNet::kMaxNodes, kNetOutputs));
  }
  BlsNet net;
  net.scale = file.Scale();
  net.feature_weights = file.Weights("feature_weights", shape[1], kNetInputs);
  net.feature_biases = file.Weights("feature_biases", shape[1], 1);
  net.enhancement_weights = file.Weights("enhancement_weights", shape[2], shape[1]);
  net.enhancement_biases = file.Weights("enhancement_biases", shape[2], 1);
  net.output_weights = file.Weights("output_weights", net.nodes(), kNetOutputs);
  if (training != nullptr) *training = file.Training();
  return net;
}

BpNet LoadBpNet(const std::filesystem::path& file, TrainingRecord* training) {
  return ParseBpNet(ReadText(file), file.string(), training);
}

BlsNet LoadBlsNet(const std::filesystem::path& file, TrainingRecord* training) {
  return ParseBlsNet(ReadText(file), file.string(), training);
}

const BpNet& DefaultBpNet() {
  static const BpNet net = ParseBpNet(kDefaultBpWeights, "agents/sector_net/default_bp.json");
  return net;
}

const BlsNet& DefaultBlsNet() {
  static const BlsNet net = ParseBlsNet(kDefaultBlsWeights, "agents/sector_net/default_bls.json");
  return net;
}

}  // namespace lanewise
