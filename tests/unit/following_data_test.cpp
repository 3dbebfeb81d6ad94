// Trajectory files to stretches of following: leaders, cuts, formats, bad input.

#include "analysis/following_data.h"

#include <fmt/core.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <limits>

#include "agents/core/check.h"
#include "tests/support/temporary_folder.h"

namespace lanewise {
namespace {

// Two cars on a lane, 20 m from front to front and both at 10 m/s, for `seconds` in steps of 0.5 s.
// The first is a bus of 12 m: the gap is 8 m.
std::string Xml(double seconds, bool named, const std::string& more = {}) {
  std::string text = "<?xml version=\"1.0\"?>\n<fcd-export>\n";
  for (double t = 0.0; t <= seconds; t += 0.5) {
    text += fmt::format(
        "<timestep time=\"{0}\">\n<vehicle id=\"b\" x=\"0\" y=\"0\" type=\"bus\" speed=\"10\" pos=\"{1}\" "
        "lane=\"e_0\"{3}/>\n<vehicle id=\"a\" type=\"car\" speed=\"10\" pos=\"{2}\" lane=\"e_0\"{4}/>\n"
        "<person id=\"p\" speed=\"1\" pos=\"{2}\" edge=\"e\"/>\n</timestep>\n",
        t, 20.0 + 10.0 * t, 10.0 * t, named ? " leaderID=\"\" leaderGap=\"-1\" leaderSpeed=\"-1\"" : "",
        named ? " leaderID=\"b\" leaderGap=\"8\" leaderSpeed=\"10\"" : "");
  }
  return text + more + "</fcd-export>\n";
}

std::string Csv(double seconds, char separator, bool prefixes) {
  std::string text =
      prefixes ? "timestep_time;vehicle_id;vehicle_speed;vehicle_lane;vehicle_pos;vehicle_type;vehicle_x\n"
               : "time;id;speed;lane;pos;type;x\n";
  for (double t = 0.0; t <= seconds; t += 0.5)
    text += fmt::format("{0};b;10;e_0;{1};bus;0\r\n{0};a;10;e_0;{2};car;\n{0};;;;;;\n", t, 20.0 + 10.0 * t,
                        10.0 * t);
  std::replace(text.begin(), text.end(), ';', separator);
  return text;
}

FollowingOptions BusOf12() {
  FollowingOptions options;
  options.lengths["bus"] = 12.0;
  return options;
}

void ExpectTheOne(const FollowingData& data) {
  ASSERT_EQ(data.episodes.size(), 1u);
  const FollowingEpisode& e = data.episodes[0];
  EXPECT_EQ(e.vehicle, "a");
  EXPECT_EQ(e.leader, "b");
  EXPECT_EQ(e.type, "car");
  ASSERT_EQ(e.time.size(), 41u);
  EXPECT_EQ(e.time.back(), 20.0);
  for (const double gap : e.gap) EXPECT_NEAR(gap, 8.0, 1e-9);
  EXPECT_EQ(e.leader_speed[7], 10.0);
  EXPECT_EQ(data.vehicles, 2);
  EXPECT_EQ(data.rows, 82);
  EXPECT_EQ(data.timesteps, 41);
}

TEST(LoadFollowing, XmlCsvAndGzipGiveTheSame) {
  const TemporaryFolder folder;
  ExpectTheOne(LoadFollowing(folder.Write("fcd.xml", Xml(20.0, false)), BusOf12()));
  const FollowingData named = LoadFollowing(folder.Write("named.xml", Xml(20.0, true)), {});
  ExpectTheOne(named);
  EXPECT_TRUE(named.leaders_named);
  EXPECT_EQ(named.unknown_lengths, 0);
  ExpectTheOne(LoadFollowing(folder.Write("sumo.csv", Csv(20.0, ';', true)), BusOf12()));
  ExpectTheOne(LoadFollowing(folder.Write("own.csv", Csv(20.0, ',', false)), BusOf12()));
  const std::string text = Xml(20.0, false), zipped = (folder / "fcd.xml.gz").string();
  gzFile file = gzopen(zipped.c_str(), "wb");
  gzwrite(file, text.data(), static_cast<unsigned>(text.size()));
  gzclose(file);
  ExpectTheOne(LoadFollowing(zipped, BusOf12()));
}

TEST(LoadFollowing, LengthsThatAreNotKnownAreTheDefaultAndCounted) {
  const TemporaryFolder folder;
  const FollowingData data = LoadFollowing(folder.Write("fcd.xml", Xml(20.0, false)), {});
  EXPECT_EQ(data.unknown_lengths, 41);
  EXPECT_NEAR(data.episodes.at(0).gap[0], 15.0, 1e-9);
}

TEST(LoadTypeLengths, ReadsThoseThatHaveOne) {
  const TemporaryFolder folder;
  const auto lengths = LoadTypeLengths(folder.Write(
      "t.xml",
      "<additional><vTypeDistribution id=\"d\"><vType id=\"bus\" length=\"12\"/></vTypeDistribution>\n"
      "<vType id=\"car\"/></additional>"));
  EXPECT_EQ(lengths, (std::map<std::string, double>{{"bus", 12.0}}));
}

std::string Rows(const std::vector<std::array<double, 4>>& rows) {
  std::string text = "time,id,speed,leaderID,leaderGap,leaderSpeed\n";
  for (const auto& [time, speed, gap, leader_speed] : rows)
    text += fmt::format("{},a,{},b,{},{}\n", time, speed, gap, leader_speed);
  return text;
}

// Speeds 10 and 10: the gap stays. At 12 s it jumps by 6 m; at 24 s no row for 5 s; at 44 s it opens beyond
// the allowed. The parts that last 10 s and 20 m are kept.
TEST(LoadFollowing, CutsWhereTheRowsDoNotBelongTogether) {
  std::vector<std::array<double, 4>> rows;
  for (int t = 0; t <= 60; ++t) {
    if (t > 24 && t < 29) continue;
    rows.push_back({t + 0.0, 10.0, t < 12 ? 20.0 : t <= 44 ? 26.0 : 150.0, 10.0});
  }
  const TemporaryFolder folder;
  const FollowingData data = LoadFollowing(folder.Write("rows.csv", Rows(rows)), {});
  ASSERT_EQ(data.episodes.size(), 3u);
  EXPECT_EQ(data.episodes[0].time.back(), 11.0);
  EXPECT_EQ(data.episodes[1].time.front(), 12.0);
  EXPECT_EQ(data.episodes[1].time.back(), 24.0);
  EXPECT_EQ(data.episodes[2].time.front(), 29.0);
  EXPECT_EQ(data.episodes[2].time.back(), 44.0);
  EXPECT_EQ(data.jumps, 2);

  FollowingOptions strict;
  strict.min_duration = 14.0;
  EXPECT_EQ(LoadFollowing(folder / "rows.csv", strict).episodes.size(), 1u);
  strict.min_duration = 5.0;
  strict.min_distance = 1000.0;
  EXPECT_EQ(LoadFollowing(folder / "rows.csv", strict).episodes.size(), 0u);
}

// SUMO writes -1.8e308 where a leader has no gap.
TEST(LoadFollowing, GapsThatAreNoneEndAStretch) {
  std::vector<std::array<double, 4>> rows;
  for (int t = 0; t <= 30; ++t)
    rows.push_back({t + 0.0, 10.0, t == 15 ? std::numeric_limits<double>::lowest() : 20.0, 10.0});
  const TemporaryFolder folder;
  EXPECT_EQ(LoadFollowing(folder.Write("rows.csv", Rows(rows)), {}).episodes.size(), 2u);
}

struct BadFile {
  const char* name;
  std::string content;
  const char* message;
};

class BadTrajectories : public testing::TestWithParam<BadFile> {};

TEST_P(BadTrajectories, AreRefusedWithLineAndReason) {
  const TemporaryFolder folder;
  const auto file = folder.Write("fcd.txt", GetParam().content);
  try {
    LoadFollowing(file, {});
    FAIL() << "not refused";
  } catch (const ConfigError& error) {
    EXPECT_NE(std::string(error.what()).find(GetParam().message), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("fcd.txt"), std::string::npos) << error.what();
  }
}

const std::string kStep = "<fcd-export>\n<timestep time=\"1\">\n";
const std::string kHead = "time,id,speed,lane,pos\n";

INSTANTIATE_TEST_SUITE_P(
    Files, BadTrajectories,
    testing::Values(
        BadFile{"Empty", "", "line 1: the file is empty"},
        BadFile{"AnotherDocument", "<routes>\n</routes>",
                "line 1: the document is <routes>; needed: <fcd-export>"},
        BadFile{"Truncated", kStep + "<vehicle id=\"a\" speed=\"1\" lane=\"e\" pos=\"1\"/>\n",
                "no well-formed XML"},
        BadFile{"Broken", kStep + "<vehicle id=\"a\" speed=1/>", "line 3: no well-formed XML"},
        BadFile{"NoSteps", "<fcd-export></fcd-export>", "no timesteps"},
        BadFile{"NoVehicles", kStep + "</timestep></fcd-export>", "no vehicles"},
        BadFile{"NoTime", "<fcd-export>\n<timestep>", "line 2: <timestep> has no attribute time"},
        BadFile{"NoId", kStep + "<vehicle speed=\"1\"/>", "line 3: <vehicle> has no attribute id"},
        BadFile{"NoSpeed", kStep + "<vehicle id=\"a\"/>", "line 3: vehicle 'a' has no attribute speed"},
        BadFile{"Nan", kStep + "<vehicle id=\"a\" speed=\"nan\"/>",
                "line 3: speed is 'nan'; a number is needed"},
        BadFile{"Negative", kStep + "<vehicle id=\"a\" speed=\"-3\"/>",
                "line 3: speed is -3; allowed: 0 to 200"},
        BadFile{"Outside", "<fcd-export>\n<vehicle id=\"a\" speed=\"1\"/>",
                "line 2: <vehicle> outside of <timestep>"},
        BadFile{"NoPlace", kStep + "<vehicle id=\"a\" speed=\"1\"/></timestep></fcd-export>",
                "nothing tells who follows whom"},
        BadFile{"Twice", kHead + "1,a,1,e,2\n1,a,1,e,2\n", "line 3: vehicle 'a' twice at time 1"},
        BadFile{"Backwards", kHead + "2,a,1,e,2\n1,a,1,e,2\n", "line 3: time is 1 after 2"},
        BadFile{"MissingColumn", "time,id,lane\n", "line 1: column 'speed' (or 'vehicle_speed') is missing"},
        BadFile{"SameColumn", "time,id,speed,vehicle_speed\n", "line 1: column 'speed' occurs twice"},
        BadFile{"ShortRow", kHead + "1,a,1\n", "line 2: 3 values; the header names 5 columns"},
        BadFile{"NoNumber", kHead + "1,a,fast,e,2\n", "line 2: speed is 'fast'; a number is needed"},
        BadFile{"EmptySpeed", kHead + "1,a,,e,2\n", "line 2: vehicle 'a' has no speed"}),
    [](const auto& info) { return info.param.name; });

TEST(LoadFollowing, AFileThatIsNotThereIsNamed) {
  EXPECT_THROW(LoadFollowing("/nowhere/fcd.xml", {}), ConfigError);
  EXPECT_THROW(LoadTypeLengths("/nowhere/types.xml"), ConfigError);
}

}  // namespace
}  // namespace lanewise
