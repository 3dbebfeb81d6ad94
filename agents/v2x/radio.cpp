#include "agents/v2x/radio.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace lanewise {

double FadingReception(double ratio2) {
  const double x = 3.0 * ratio2;
  return std::exp(-x) * (1.0 + x + 0.5 * x * x);
}

double HiddenShare(double distance, double carrier_sense_range) {
  const double x = std::min(1.0, distance / (2.0 * carrier_sense_range));
  return 1.0 - 2.0 / std::numbers::pi * (std::acos(x) - x * std::sqrt(1.0 - x * x));
}

double CollisionFree(double load, double hidden_share) {
  return std::exp(-2.0 * load * hidden_share);
}

double Airtime(double bytes, double bitrate) {
  constexpr double kPreambleAndSignal = 40e-6, kSymbol = 8e-6;  // [s]
  constexpr double kServiceAndTail = 22.0;                      // [bit]
  const double bits_per_symbol = bitrate * kSymbol;
  return kPreambleAndSignal + kSymbol * std::ceil((8.0 * bytes + kServiceAndTail) / bits_per_symbol);
}

}  // namespace lanewise
