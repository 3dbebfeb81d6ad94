#include "scenarios/state_trace.h"

namespace lanewise {

void StateTrace::Add(std::int64_t step, const Traffic& traffic) {
  const Motion& now = traffic.now;
  StepHashRow row;
  row.step = step;
  for (std::size_t i = 0; i < traffic.vehicle_count; ++i) {
    const auto number = static_cast<std::uint64_t>(traffic.number[i]);
    StateHash own;
    const auto add = [&](auto word) {
      own.Add(word);
      rolling_.Add(word);
    };
    add(number);
    add(static_cast<std::uint64_t>(now.lane[i]));
    add(now.s[i]);
    add(now.d[i]);
    add(now.heading_error[i]);
    add(now.speed[i]);
    add(now.steering_angle[i]);
    row.vehicle_sum += own.value();
    row.weighted_sum += (number + 1) * own.value();
  }
  row.rolling = rolling_.value();
  rows_.push_back(row);
}

std::int32_t FindDifferingVehicle(const StepHashRow& a, const StepHashRow& b, std::int32_t numbers) {
  const std::uint64_t sum = a.vehicle_sum - b.vehicle_sum, weighted = a.weighted_sum - b.weighted_sum;
  if (sum == 0) return kNone;
  for (std::int32_t number = 0; number < numbers; ++number) {
    if ((static_cast<std::uint64_t>(number) + 1) * sum == weighted) return number;
  }
  return kNone;
}

}  // namespace lanewise
