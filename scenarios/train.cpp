#include "scenarios/train.h"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <memory>
#include <numeric>
#include <optional>

#include "agents/core/check.h"
#include "agents/sector_net/bls_training.h"
#include "agents/sector_net/bp_training.h"
#include "agents/sector_net/net_score.h"
#include "agents/sector_net/weight_file.h"
#include "scenarios/plot.h"

namespace lanewise {
namespace {

using Clock = std::chrono::steady_clock;

// [A]: 130 samples to train, 100 to test.
constexpr std::size_t kPaperTraining = 130, kPaperTest = 100;

double SecondsSince(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

void CheckRange(const char* option, double value, double min, double max) {
  if (!(value >= min && value <= max))
    throw ConfigError(fmt::format("{}: {}; allowed: {} to {}", option, value, min, max));
}

/// What both networks are trained and tested with.
struct DataOptions {
  std::string samples, output;
  std::optional<std::int64_t> training, test;
  std::uint64_t seed{1};
  int rows{10};
  bool all{false}, balance{false}, force{false};
};

void AddDataOptions(CLI::App* app, DataOptions* o) {
  app->add_option("--samples", o->samples,
                  "sample file (CSV, as `lanewise run --record-samples` writes it); default: the 255 sector "
                  "codes that leave a way, labelled by rule: forward if both sectors ahead are free, else "
                  "to the side with more free sectors, else left");
  app->add_option("--training", o->training,
                  "samples to train with; default: 130 of the generated ones as in [A], 13/23 of a file's");
  app->add_option("--test", o->test, "samples held out; default: 100 as in [A], the rest of a file's");
  app->add_flag("--all", o->all,
                "train with every sample and hold none out: a network to drive with, not an experiment");
  app->add_option("--seed", o->seed, "of the split and of the random weights")->capture_default_str();
  app->add_option("-o,--output", o->output, "weight file (JSON); without it nothing is kept");
  app->add_option("--rows", o->rows, "test samples shown, those with the largest errors first")
      ->capture_default_str();
  app->add_flag(
      "--balance", o->balance,
      "weigh the training samples so that left, forward and right count the same: in traffic nearly "
      "all go forward, and a network that always does is nearly always right");
  app->add_flag("--force", o->force, "replace output files that exist");
}

struct TrainingData {
  SampleSplit split;
  std::string origin;       ///< File, or "generated".
  std::size_t rows{0};      ///< In the file.
  std::size_t training{0};  ///< Rows before equal ones were merged.
  std::size_t test{0};      ///< 0: none is held out, and split.test holds those trained with.
};

/// How many samples to train with and to test with; what is not asked for is as in [A].
void ChooseSizes(const DataOptions& o, TrainingData* data) {
  if (o.all) {
    if (o.training || o.test)
      throw ConfigError("--all: trains with every sample; leave out --training and --test");
    data->training = data->rows;
    return;
  }
  data->training = kPaperTraining;
  data->test = kPaperTest;
  if (!o.samples.empty()) {
    data->training = std::max<std::size_t>(1, data->rows * kPaperTraining / (kPaperTraining + kPaperTest));
    data->test = data->rows - data->training;
  }
  if (o.training) data->training = static_cast<std::size_t>(*o.training);
  if (o.test) {
    data->test = static_cast<std::size_t>(*o.test);
  } else if (o.training && !o.samples.empty()) {
    data->test = data->rows - std::min(data->rows, data->training);
  }
  if (data->test == 0)
    throw ConfigError(fmt::format("{}: {} samples; none are left to test", data->origin, data->rows));
}

TrainingData LoadData(const DataOptions& o) {
  CheckRange("--rows", o.rows, 0, 1e6);
  CheckOutputFile("--output", o.output, o.force);
  if (o.training) CheckRange("--training", static_cast<double>(*o.training), 1, 1e9);
  if (o.test) CheckRange("--test", static_cast<double>(*o.test), 1, 1e9);
  TrainingData data;
  data.origin = o.samples.empty() ? "generated" : o.samples;
  std::vector<LabelledScan> samples = o.samples.empty() ? GeneratedSamples() : LoadSamples(o.samples);
  data.rows = samples.size();
  ChooseSizes(o, &data);
  try {
    data.split = SplitSamples(std::move(samples), data.training, data.test, o.seed);
  } catch (const ConfigError& error) {
    throw ConfigError(fmt::format("{}: {}", data.origin, error.what()));
  }
  if (o.all) {
    data.split.test = data.split.training;
    fmt::print("{} training samples ({}), seed {}; none held out: the scores are of those trained with\n",
               data.training, data.origin, o.seed);
  } else {
    fmt::print(
        "{} training and {} test samples of {} ({}), seed {}; {} of the test samples' scans also occur in "
        "training\n",
        data.training, data.test, data.rows, data.origin, o.seed, CountSeen(data.split));
  }
  data.split.training = MergeEqual(data.split.training);
  data.split.test = MergeEqual(data.split.test);
  if (o.balance) BalanceWays(&data.split.training);
  if (!o.samples.empty()) {
    const double most = MostPossible(data.split.test);
    fmt::print(
        "{} different training samples; equal scans went different ways: no network can have more than "
        "{:.0f} of the {} {} samples right ({:.1f} %)\n",
        data.split.training.size(), most, o.all ? data.training : data.test, o.all ? "training" : "test",
        100.0 * most / static_cast<double>(o.all ? data.training : data.test));
  }
  return data;
}

/// How far a training is, on stderr, from its third second on.
class TrainingLine {
 public:
  TrainingLine(int max_epochs, double goal) : max_epochs_(max_epochs), goal_(goal), shown_(Clock::now()) {}
  ~TrainingLine() {
    if (any_ && isatty(STDERR_FILENO) != 0) fmt::print(stderr, "\n");
  }
  bool operator()(int epoch, double error) {
    const bool terminal = isatty(STDERR_FILENO) != 0;
    if (epoch % 64 != 0 || SecondsSince(shown_) < (any_ && !terminal ? 10.0 : 2.0)) return true;
    shown_ = Clock::now();
    any_ = true;
    fmt::print(stderr, "{}epoch {} of at most {}: mean squared error {:.3g}, goal {:g}{}",
               terminal ? "\r\x1b[K" : "", epoch, max_epochs_, error, goal_, terminal ? "" : "\n");
    std::fflush(stderr);
    return true;
  }

 private:
  int max_epochs_;
  double goal_;
  Clock::time_point shown_;
  bool any_{false};
};

void PrintErrorCurve(const BpTraining& training) {
  fmt::print("\nError against epochs (Fig. 5 of [A])\n{:>8}  mean squared error\n", "epoch");
  const int last = training.epochs();
  const auto show = [&](int epoch) {
    fmt::print("{:>8}  {:.6f}\n", epoch, training.error[static_cast<std::size_t>(epoch)]);
  };
  show(0);
  // 1, 2, 5, 10, 20, 50 ...
  for (int decade = 1; decade < last; decade *= 10) {
    for (const int factor : {1, 2, 5}) {
      if (decade * factor < last) show(decade * factor);
    }
  }
  if (last > 0) show(last);
}

std::string CodeText(const SectorInputs& sectors) {
  std::string text;
  for (const double s : sectors) text += s == 0.0 ? "0" : s == 1.0 ? "1" : fmt::format("({:g})", s);
  return text;
}

template <class Net>
void PrintTable(const Net& net, const std::vector<LabelledScan>& test, const char* which, int rows) {
  if (rows <= 0) return;
  std::vector<std::size_t> order(test.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto error = [&](std::size_t i) { return LargestError(net.Forward(test[i].sectors), test[i].way); };
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return error(a) > error(b); });
  order.resize(std::min(order.size(), static_cast<std::size_t>(rows)));
  fmt::print(
      "\nOutputs on {} samples (Table 1 of [A]): the {} with the largest errors of {}; sectors from left "
      "to right, 1 = free\n"
      "{:<10} {:<9} {:>9} {:>9} {:>9}  {:>9}\n",
      which, order.size(), test.size(), "sectors", "target", "left", "forward", "right", "error");
  for (const std::size_t i : order) {
    const NetOutputs y = net.Forward(test[i].sectors), d = TargetOf(test[i].way);
    fmt::print("{:<10} [{:g} {:g} {:g}]   {:>9.6f} {:>9.6f} {:>9.6f}  {:>9.6f}\n", CodeText(test[i].sectors),
               d[0], d[1], d[2], y[0], y[1], y[2], error(i));
  }
}

void PrintScore(const char* name, const NetScore& score) {
  fmt::print(
      "{}: mean squared error {:.6f}; rounding gives the target in {:g} of {:g}, the largest output in {:g} "
      "({:g} of {:g} left, {:g} of {:g} forward, {:g} of {:g} right); largest error {:.6f}\n",
      name, score.mean_squared_error, score.rounded, score.samples, score.largest, score.found[0],
      score.taken[0], score.found[1], score.taken[1], score.found[2], score.taken[2], score.largest_error);
}

template <class Net>
void Conclude(const Net& net, const TrainingData& data, const DataOptions& o, TrainingRecord record) {
  PrintTable(net, data.split.test, o.all ? "training" : "test", o.rows);
  const NetScore training = ScoreNet(net, data.split.training), test = ScoreNet(net, data.split.test);
  fmt::print("\n");
  PrintScore(o.balance ? "training samples, balanced" : "training samples", training);
  if (!o.all) PrintScore("test samples", test);
  if (o.output.empty()) return;
  record.samples = data.origin;
  record.training_samples = static_cast<std::int64_t>(data.training);
  record.test_samples = static_cast<std::int64_t>(data.test);
  record.seed = o.seed;
  record.training_error = training.mean_squared_error;
  record.test_correct = o.all ? 0 : static_cast<std::int64_t>(test.rounded);
  record.program = LANEWISE_VERSION;
  SaveWeights(o.output, net, record);
  fmt::print("weights in {}\n", o.output);
}

/// [s] of one inference: the shortest of several rounds over all codes.
template <class Net>
double InferenceTime(const Net& net) {
  constexpr int kRounds = 20, kRepeats = 20;
  double shortest = 1.0, sum = 0.0;
  for (int round = 0; round < kRounds; ++round) {
    const auto start = Clock::now();
    for (int repeat = 0; repeat < kRepeats; ++repeat) {
      for (unsigned code = 0; code < 256; ++code)
        sum += net.Forward(InputsOfCode(static_cast<std::uint8_t>(code)))[0];
    }
    shortest = std::min(shortest, SecondsSince(start) / (256.0 * kRepeats));
  }
  // The sum is used, so that the work is done.
  return std::isfinite(sum) ? shortest : 0.0;
}

struct BpOptions {
  DataOptions data;
  BpTrainingOptions training;
  std::string method{"gd"}, error_csv, plot;
};

BpTraining TrainBp(const TrainingData& data, const BpTrainingOptions& options, const std::string& method,
                   std::uint64_t seed, BpNet* net) {
  TrainingLine line(options.max_epochs, options.goal);
  const TrainingProgress progress = [&line](int epoch, double error) { return line(epoch, error); };
  *net = RandomBpNet(seed);
  return method == "lm" ? TrainByLevenbergMarquardt(data.split.training, options, progress, net)
                        : TrainByGradientDescent(data.split.training, options, seed, progress, net);
}

void WriteErrorCsv(const std::string& file, const BpTraining& training) {
  std::ofstream out(file);
  out << "epoch,mean_squared_error\n";
  for (std::size_t epoch = 0; epoch < training.error.size(); ++epoch)
    out << fmt::format("{},{}\n", epoch, training.error[epoch]);
  out.close();
  if (!out) throw ConfigError(fmt::format("{}: cannot be written", file));
}

int RunTrainBp(const BpOptions& o) {
  CheckRange("--goal", o.training.goal, 0.0, 1.0);
  CheckRange("--epochs", o.training.max_epochs, 1, 100'000'000);
  CheckRange("--rate", o.training.learning_rate, 1e-6, 10.0);
  if (o.method != "gd" && o.method != "lm")
    throw ConfigError(fmt::format("--method: unknown value '{}'; allowed: gd, lm", o.method));
  if (o.method == "lm" && o.training.sample_by_sample)
    throw ConfigError("--sample-by-sample: is for gradient descent; leave it out or use --method gd");
  CheckOutputFile("--error-csv", o.error_csv, o.data.force);
  CheckPlotFile("--plot", o.plot, o.data.force);
  const TrainingData data = LoadData(o.data);
  BpNet net;
  const BpTraining training = TrainBp(data, o.training, o.method, o.data.seed, &net);
  const char* method = o.method == "lm"              ? "Levenberg-Marquardt"
                       : o.training.sample_by_sample ? "gradient descent, sample by sample"
                                                     : "gradient descent";
  PrintErrorCurve(training);
  fmt::print("BP 8-16-3 by {}: {} after {} epochs in {:.3g} s\n", method,
             training.reached ? fmt::format("goal {:g} reached", o.training.goal)
                              : fmt::format("goal {:g} not reached", o.training.goal),
             training.epochs(), training.wall_time);
  if (!o.error_csv.empty()) WriteErrorCsv(o.error_csv, training);
  if (!o.plot.empty()) {
    PlotLine line{method, {}, training.error, false};
    line.x.resize(training.error.size());
    std::iota(line.x.begin(), line.x.end(), 0.0);
    const double last = static_cast<double>(training.epochs());
    const PlotPanel panel{
        "Error against epochs",
        "epoch",
        "mean squared error",
        true,
        true,
        {line, {"goal", {1.0, std::max(1.0, last)}, {o.training.goal, o.training.goal}, true}}};
    DrawPlot(o.plot, {&panel, 1});
  }
  TrainingRecord record;
  record.method = method;
  record.epochs = training.epochs();
  Conclude(net, data, o.data, record);
  return training.reached ? 0 : 1;
}

struct BlsCommandOptions {
  DataOptions data;
  BlsOptions bls;
  int grow{0};
  double simplify{0.0};
  bool against_bp{false};
};

double LargestDifference(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  return (a - b).cwiseAbs().maxCoeff();
}

/// Part k of n equal parts of `total`, the last one taking what is left over.
int PartEnd(int total, int k, int n) {
  return static_cast<int>(static_cast<std::int64_t>(total) * k / n);
}

/// Grows a network to its full size in steps and compares it, at each, with one trained at once.
void ShowGrowth(const TrainingData& data, const BlsCommandOptions& o) {
  const std::span<const LabelledScan> all(data.split.training);
  const int parts = o.grow + 1, samples = static_cast<int>(all.size());
  const auto nodes = [&](int k) { return PartEnd(o.bls.enhancements, k, parts); };
  const auto until = [&](int k) { return static_cast<std::size_t>(PartEnd(samples, k, parts)); };
  BlsOptions options = o.bls;
  options.enhancements = nodes(1);
  BlsTrainer grown(all.first(until(1)), options, o.data.seed);
  fmt::print("\nGrown without training anew, against trained at once\n{:>5} {:>8} {:>8}  {:>10} {:>10}  {}\n",
             "step", "nodes", "samples", "grown [ms]", "anew [ms]", "largest difference of a weight");
  for (int k = 1; k <= parts; ++k) {
    const auto start = Clock::now();
    if (k > 1) {
      grown.AddEnhancements(nodes(k) - nodes(k - 1));
      grown.AddSamples(all.subspan(until(k - 1), until(k) - until(k - 1)));
    }
    const double growing = SecondsSince(start);
    options.enhancements = nodes(k);
    const auto again = Clock::now();
    const BlsTrainer anew(all.first(until(k)), options, o.data.seed);
    fmt::print("{:>5} {:>8} {:>8}  {:>10} {:>10.3f}  {:.2e}\n", k - 1, grown.net().nodes(), until(k),
               k == 1 ? "" : fmt::format("{:.3f}", 1e3 * growing), 1e3 * SecondsSince(again),
               LargestDifference(grown.net().output_weights, anew.net().output_weights));
  }
  fmt::print("against a QR decomposition of all samples: {:.2e}\n",
             LargestDifference(grown.net().output_weights,
                               RetrainedOutputWeights(grown.net(), data.split.training, o.bls.ridge)));
}

void CompareWithBp(const TrainingData& data, const BlsNet& bls, double bls_time, std::uint64_t seed) {
  BpNet bp;
  const BpTraining training = TrainBp(data, {}, "gd", seed, &bp);
  const NetScore bp_score = ScoreNet(bp, data.split.test), bls_score = ScoreNet(bls, data.split.test);
  fmt::print(
      "\nThe same samples, BP 8-16-3 by gradient descent against broad learning\n"
      "{:<38} {:>12} {:>12}\n"
      "{:<38} {:>12.3f} {:>12.3f}\n{:<38} {:>12} {:>12}\n{:<38} {:>12g} {:>12g}\n{:<38} {:>12g} {:>12g}\n"
      "{:<38} {:>12.6f} {:>12.6f}\n{:<38} {:>12.3f} {:>12.3f}\n",
      "", "BP", "BLS", "training [ms]", 1e3 * training.wall_time, 1e3 * bls_time, "epochs", training.epochs(),
      1, "test samples right after rounding", bp_score.rounded, bls_score.rounded,
      "test samples right by largest output", bp_score.largest, bls_score.largest, "largest test error",
      bp_score.largest_error, bls_score.largest_error, "one inference [us]", 1e6 * InferenceTime(bp),
      1e6 * InferenceTime(bls));
  fmt::print("broad learning trains {:.0f} times as fast{}\n", training.wall_time / bls_time,
             training.reached ? "" : " (BP did not reach its goal within its epochs)");
}

int RunTrainBls(const BlsCommandOptions& o) {
  CheckRange("--grow", o.grow, 0, 100);
  CheckRange("--simplify", o.simplify, 0.0, 0.999);
  Eigen::setNbThreads(1);  // The matrices are small: a team of threads costs more than it saves.
  const TrainingData data = LoadData(o.data);
  const auto start = Clock::now();
  const BlsTrainer trainer(data.split.training, o.bls, o.data.seed);
  const double first = SecondsSince(start);
  // The first training also loads code and memory: the shorter of both counts.
  const auto again = Clock::now();
  BlsNet net = BlsTrainer(data.split.training, o.bls, o.data.seed).net();
  const double wall_time = std::min(first, SecondsSince(again));
  fmt::print("BLS, {} feature and {} enhancement nodes, ridge {:g}: trained in {:.3g} ms\n", net.features(),
             net.enhancements(), o.bls.ridge, 1e3 * wall_time);
  if (o.grow > 0) ShowGrowth(data, o);
  TrainingRecord record;
  record.method = "ridge regression";
  record.epochs = 1;
  if (o.simplify > 0.0) {
    const NetScore before = ScoreNet(net, data.split.test);
    net = Simplify(net, data.split.training, o.bls.ridge, o.simplify);
    fmt::print("\nsimplified to {} feature and {} enhancement nodes\n", net.features(), net.enhancements());
    PrintScore("test samples before", before);
    record.method += fmt::format(", simplified at {:g}", o.simplify);
  }
  if (o.against_bp) CompareWithBp(data, net, wall_time, o.data.seed);
  Conclude(net, data, o.data, record);
  return 0;
}

void AddBp(CLI::App* train, std::function<int()>* chosen) {
  const auto o = std::make_shared<BpOptions>();
  CLI::App* bp = train->add_subcommand("bp", "The network of [A], 8-16-3, by error back-propagation");
  AddDataOptions(bp, &o->data);
  bp->add_option("--method", o->method,
                 "gd: gradient descent as in [A]; lm: Levenberg-Marquardt, far fewer epochs")
      ->capture_default_str();
  bp->add_option("--goal", o->training.goal, "mean squared error to end at")->capture_default_str();
  bp->add_option("--epochs", o->training.max_epochs, "at most so many")->capture_default_str();
  bp->add_option("--rate", o->training.learning_rate, "learning rate of gradient descent")
      ->capture_default_str();
  bp->add_flag("--sample-by-sample", o->training.sample_by_sample,
               "gradient descent with a step after each sample instead of after all");
  bp->add_option("--error-csv", o->error_csv, "the error of each epoch as CSV");
  bp->add_option("--plot", o->plot,
                 "error against epochs (Fig. 5 of [A]) as .svg, .png or .pdf; needs gnuplot");
  bp->footer(
      "Examples:\n"
      "  lanewise train bp                                        (the experiment of [A])\n"
      "  lanewise train bp --method lm --goal 1e-6 --plot error.svg -o bp.json\n"
      "  lanewise train bp --method lm --goal 1e-6 --all -o bp.json   (to drive with)\n"
      "  lanewise run --scenario town --policy dwa --record-samples town.csv\n"
      "  lanewise train bp --samples town.csv --balance --method lm --epochs 200 -o town.json   (imitates "
      "dwa)\n"
      "Exit code 1: the goal was not reached; the weights are written all the same.");
  bp->callback([o, chosen] { *chosen = [o] { return RunTrainBp(*o); }; });
}

void AddBls(CLI::App* train, std::function<int()>* chosen) {
  const auto o = std::make_shared<BlsCommandOptions>();
  CLI::App* bls =
      train->add_subcommand("bls", "Broad learning ([C]): random nodes, outputs by ridge regression");
  AddDataOptions(bls, &o->data);
  bls->add_option("--feature-groups", o->bls.feature_groups, "groups of feature nodes")
      ->capture_default_str();
  bls->add_option("--features-per-group", o->bls.features_per_group, "nodes of a group")
      ->capture_default_str();
  bls->add_option("--enhancements", o->bls.enhancements, "enhancement nodes")->capture_default_str();
  bls->add_option("--ridge", o->bls.ridge, "lambda of the ridge regression")->capture_default_str();
  bls->add_option("--enhancement-scale", o->bls.enhancement_scale,
                  "standard deviation of the enhancement nodes' sums")
      ->capture_default_str();
  bls->add_option("--feature-reach", o->bls.feature_reach,
                  "sectors over which the weights of a node that compares the sides are correlated; 0 = "
                  "independent")
      ->capture_default_str();
  bls->add_option(
         "--local-share", o->bls.local_share,
         "weight in an enhancement node of what stands in one pair of sectors, against how the sides "
         "compare")
      ->capture_default_str();
  bls->add_option(
         "--grow", o->grow,
         "also grow a smaller network by nodes and samples in so many steps, without training anew, and "
         "compare its weights with those of one trained at once")
      ->capture_default_str();
  bls->add_option("--simplify", o->simplify,
                  "low-rank simplification: drop what stays below this share of the largest; 0 = none")
      ->capture_default_str();
  bls->add_flag(
      "--against-bp", o->against_bp,
      "also train BP by gradient descent on the same samples: accuracy, training and inference time");
  bls->footer(
      "Examples:\n"
      "  lanewise train bls --against-bp\n"
      "  lanewise train bls --grow 4                     (incremental learning)\n"
      "  lanewise train bls --simplify 0.05 -o bls.json\n"
      "  lanewise train bls --samples town.csv --enhancements 120 -o town_bls.json");
  bls->callback([o, chosen] { *chosen = [o] { return RunTrainBls(*o); }; });
}

}  // namespace

void AddTrainCommand(CLI::App* app, std::function<int()>* chosen) {
  CLI::App* train = app->add_subcommand("train", "Train a sector network and write its weight file");
  train->require_subcommand(1);
  AddBp(train, chosen);
  AddBls(train, chosen);
}

}  // namespace lanewise
