#include "agents/core/params.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <string>

#include "agents/agent_params.h"

namespace lanewise {
namespace {

std::string SetError(const std::string& name, double value) {
  AgentParams params;
  try {
    SetParam(&params, name, value, "my.toml, line 3");
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "no error";
}

TEST(Params, SetsByName) {
  AgentParams params;
  SetParam(&params, "dwa.clearance_weight", 1.5, "--set");
  SetParam(&params, "dwa.path_samples", 9, "--set");
  EXPECT_EQ(params.dwa.clearance_weight, 1.5);
  EXPECT_EQ(params.dwa.path_samples, 9);
  EXPECT_EQ(params.dwa.goal_weight, AgentParams{}.dwa.goal_weight);
}

TEST(Params, AnUnknownNameGetsTheNearestOne) {
  EXPECT_EQ(
      SetError("dwa.clearance_wieght", 1.0),
      "my.toml, line 3: unknown parameter 'dwa.clearance_wieght' (did you mean 'dwa.clearance_weight'?); "
      "`lanewise params` lists all");
}

TEST(Params, OutOfRangeNamesFoundAndAllowed) {
  EXPECT_EQ(SetError("dwa.horizon", 7.0),
            "my.toml, line 3: parameter 'dwa.horizon' is 7 s; allowed: 1 to 6 s");
  EXPECT_NE(SetError("dwa.horizon", std::nan("")), "no error");
  EXPECT_EQ(SetError("dwa.horizon", 6.0), "no error");  // The range is closed.
}

TEST(Params, CountsAreWholeNumbers) {
  EXPECT_EQ(SetError("dwa.speed_samples", 7.5),
            "my.toml, line 3: parameter 'dwa.speed_samples' is 7.5; allowed: a whole number");
}

TEST(Params, ARefusedValueChangesNothing) {
  AgentParams params;
  EXPECT_THROW(SetParam(&params, "dwa.speed_samples", 7.5, ""), ConfigError);
  EXPECT_THROW(SetParam(&params, "dwa.horizon", 60.0, ""), ConfigError);
  EXPECT_EQ(params.dwa.speed_samples, AgentParams{}.dwa.speed_samples);
  EXPECT_EQ(params.dwa.horizon, AgentParams{}.dwa.horizon);
}

TEST(Params, EveryDefaultIsAllowedAndEveryNameIsUnique) {
  std::set<std::string> names;
  for (const ParamDescription& p : DescribeParams(AgentParams{})) {
    EXPECT_TRUE(names.insert(p.name).second) << p.name;
    EXPECT_GE(p.value, p.range.min) << p.name;
    EXPECT_LE(p.value, p.range.max) << p.name;
    EXPECT_FALSE(p.meaning.empty()) << p.name;
    EXPECT_FALSE(p.source.empty()) << p.name;
  }
  EXPECT_EQ(names.count("control.speed_kp"), 1u);
}

TEST(Params, EditDistance) {
  EXPECT_EQ(EditDistance("kitten", "sitting"), 3u);  // k>s, e>i, +g.
  EXPECT_EQ(EditDistance("", "abc"), 3u);
  EXPECT_EQ(EditDistance("same", "same"), 0u);
}

}  // namespace
}  // namespace lanewise
