// One inference of the networks that choose the way.

#include <benchmark/benchmark.h>

#include "agents/sector_net/weight_file.h"

namespace lanewise {
namespace {

template <class Net>
void Infer(benchmark::State& state, const Net& net) {
  std::uint8_t code = 1;
  for (auto _ : state) {
    benchmark::DoNotOptimize(code);
    benchmark::DoNotOptimize(net.Forward(InputsOfCode(code)));
    ++code;
  }
}

void BM_BpInference(benchmark::State& state) {
  Infer(state, DefaultBpNet());
}
BENCHMARK(BM_BpInference);

void BM_BlsInference(benchmark::State& state) {
  Infer(state, DefaultBlsNet());
}
BENCHMARK(BM_BlsInference);

}  // namespace
}  // namespace lanewise
