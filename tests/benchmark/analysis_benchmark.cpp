// Measures and results.

#include <benchmark/benchmark.h>

#include <cmath>
#include <filesystem>
#include <vector>

#include "analysis/conflict_geometry.h"
#include "analysis/results_file.h"

namespace lanewise {
namespace {

void BM_TimeToContact(benchmark::State& state) {
  const MovingBox a = BoxOf({{0.0, 0.0, 0.0}, 4.8, 1.8}, {12.0, 0.0});
  MovingBox b = BoxOf({{20.0, 1.0, 0.1}, 4.8, 1.8}, {5.0, 0.2});
  for (auto _ : state) {
    benchmark::DoNotOptimize(b);
    benchmark::DoNotOptimize(TimeToContact(a, b, 3.0));
  }
}
BENCHMARK(BM_TimeToContact);

// From the first Add to the end of Finish: what the disk really has.
void BM_ResultsWriter(benchmark::State& state) {
  const std::filesystem::path file =
      std::filesystem::temp_directory_path() / "lanewise_writer_benchmark.sqlite";
  const auto remove = [&] {
    for (const char* tail : {"", "-wal", "-shm"}) std::filesystem::remove(file.string() + tail);
  };
  constexpr int kSteps = 200, kVehicles = 1000;
  std::vector<TrajectoryRow> rows(kVehicles);
  for (auto _ : state) {
    state.PauseTiming();
    remove();
    RunInfo info;
    auto writer = std::make_unique<RunWriter>(ResultsFile::Open(file, ResultsFile::Mode::kAppend), info);
    state.ResumeTiming();
    for (int step = 0; step < kSteps; ++step) {
      for (int i = 0; i < kVehicles; ++i) {
        rows[i] = {0.1 * step,       i,   i % 50,     10.0 * i + step, std::sin(i + step), 0.01 * i,
                   10.0 + 0.001 * i, 0.1, 1.0 * step, 0.01 * i};
      }
      writer->Add(rows);
    }
    writer->Finish({});
  }
  remove();
  state.SetItemsProcessed(state.iterations() * kSteps * kVehicles);  // Rows.
}
BENCHMARK(BM_ResultsWriter)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace lanewise
