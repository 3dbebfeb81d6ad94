// `lanewise report`: the page stands on its own, and headless Chromium draws it: no error, charts answer to
// the mouse.

#include <SQLiteCpp/SQLiteCpp.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <regex>
#include <string>
#include <vector>

#include "analysis/results_file.h"
#include "tests/support/child_process.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

#define EXPECT_CONTAINS(text, part) EXPECT_NE(std::string(text).find(part), std::string::npos) << (text)

bool HasChromium() {
  return std::system("chromium --version >/dev/null 2>&1") == 0;
}

class ReportCli : public testing::Test {
 protected:
  void Record(const std::string& policy, const std::string& seed,
              const std::vector<std::string>& more = {}) const {
    std::vector<std::string> words{"run", "--scenario", "town", "--policy", policy,      "--seed",
                                   seed,  "--end",      "90",   "-q",       "--results", Results()};
    words.insert(words.end(), more.begin(), more.end());
    ChildProcess run(words);
    ASSERT_EQ(run.Wait(), 0) << run.Errors();
  }
  std::string Results() const { return (folder_ / "town.sqlite").string(); }
  std::string Page() const { return (folder_ / "report.html").string(); }
  std::string Draw(const std::string& page) const;
  TemporaryFolder folder_;
};

/// Waits until the page is drawn, moves the mouse over a point of each chart, and writes what the tooltips
/// said into the document, where --dump-dom finds it.
constexpr char kMouse[] = R"js(<script>
window.addEventListener('load', () => setTimeout(async () => {
  const said = [];
  for (const box of document.querySelectorAll('.chart')) {
    const chart = echarts.getInstanceByDom(box);
    const canvas = box.querySelector('canvas');
    const place = canvas.getBoundingClientRect();
    const series = chart.getOption().series;
    const k = series.findIndex((s) => s.type !== 'lines' && s.type !== 'custom' && s.data.length > 0);
    const item = series[k].data[Math.floor(series[k].data.length / 2)];
    const [x, y] = chart.convertToPixel({seriesIndex: k}, (item.value || item).slice(0, 2));
    for (const type of ['mouseover', 'mousemove'])
      canvas.dispatchEvent(new MouseEvent(type, {clientX: place.left + x, clientY: place.top + y, bubbles: true}));
    await new Promise((done) => setTimeout(done, 250));
    const tip = [...box.children].find((c) => c.style.pointerEvents === 'none' && c.style.visibility !== 'hidden');
    said.push(box.id + '=' + (tip && tip.textContent ? 'tip' : 'silent'));
  }
  document.documentElement.dataset.said = said.join(' ');
}, 300));
</script>)js";

/// Draws a page in headless Chromium, which must not complain. @return what its charts answered to the mouse.
std::string ReportCli::Draw(const std::string& page) const {
  std::string watched = page;
  watched.insert(watched.rfind("</body>"), kMouse);
  const fs::path html = folder_.Write("watched.html", watched);
  const std::string command = "HOME=" + folder_.path().string() +
                              " timeout 50 chromium --headless --no-sandbox --disable-gpu "
                              "--disable-dev-shm-usage --enable-logging=stderr "
                              "--window-size=1240,6000 --virtual-time-budget=8000 --user-data-dir=" +
                              (folder_ / "profile").string() + " --dump-dom file://" + html.string() + " >" +
                              (folder_ / "dom").string() + " 2>" + (folder_ / "log").string();
  EXPECT_EQ(std::system(command.c_str()), 0) << ReadFile(folder_ / "log");
  const std::string log = ReadFile(folder_ / "log");
  EXPECT_EQ(log.find("CONSOLE"), std::string::npos) << log;
  const std::string dom = ReadFile(folder_ / "dom");
  std::smatch said;
  const std::string head = dom.substr(0, 2000);
  EXPECT_TRUE(std::regex_search(head, said, std::regex("data-said=\"([^\"]*)\""))) << head;
  return said[1].str();
}

TEST_F(ReportCli, ChromiumDrawsItAndChartsAnswerToTheMouse) {
  Record("sumo", "1");
  Record("dwa", "1");
  Record("sumo", "2");
  Record("dwa", "2");
  ChildProcess child({"report", Results(), "-o", Page()});
  ASSERT_EQ(child.Wait(), 0) << child.Errors();
  const std::string page = ReadFile(Page());
  EXPECT_LT(page.size(), 15'000'000u);
  // Nothing is loaded from elsewhere: no source, style sheet or import.
  EXPECT_FALSE(std::regex_search(page.substr(0, 4000), std::regex("(src|href)=|@import|url\\(")));
  if (!HasChromium()) GTEST_SKIP() << "no chromium (Debian's chromium)";
  const std::string said = Draw(page);
  for (const char* chart :
       {"shares", "metric", "time-space", "flow-density", "cdf", "comfort", "map", "penetration"})
    EXPECT_CONTAINS(said, std::string(chart) + "=tip");
  EXPECT_EQ(said.find("radio"), std::string::npos) << said;  // Nobody carried one.
}

TEST_F(ReportCli, WhatWentOverTheRadioIsDrawn) {
  for (const char* level : {"range", "loaded"}) {
    for (const char* share : {"0.5", "1"})
      Record("dwa", "1",
             {"--v2x", level, "--set", std::string("v2x.share=") + share, "--coordinate", "green-advice"});
  }
  ChildProcess child({"report", Results(), "-o", Page()});
  ASSERT_EQ(child.Wait(), 0) << child.Errors();
  const std::string page = ReadFile(Page());
  EXPECT_CONTAINS(page, "\"radio_share\":0.5");
  if (!HasChromium()) GTEST_SKIP() << "no chromium (Debian's chromium)";
  const std::string said = Draw(page);
  EXPECT_CONTAINS(said, "radio=tip");
  EXPECT_CONTAINS(said, "radio-share=tip");
}

TEST_F(ReportCli, OnePolicyIsMarkedPartial) {
  Record("dwa", "1");
  ChildProcess child({"report", Results(), "-o", Page()});
  EXPECT_EQ(child.Wait(), 0) << child.Errors();
  EXPECT_CONTAINS(child.Output(), "PARTIAL");
  EXPECT_NE(ReadFile(Page()).find("only one policy, dwa"), std::string::npos);
}

TEST_F(ReportCli, FileWithoutRunsIsRefused) {
  ResultsFile::Open(Results(), ResultsFile::Mode::kAppend);
  ChildProcess child({"report", Results(), "-o", Page()});
  EXPECT_EQ(child.Wait(), 2);
  EXPECT_CONTAINS(child.Errors(), "it holds no runs");
  EXPECT_FALSE(fs::exists(Page()));
}

TEST_F(ReportCli, UnpairedSeedsAndWhatIsNotANumberAreTold) {
  Record("dwa", "1");
  Record("sumo", "1");
  Record("dwa", "2");
  SQLite::Database(Results(), SQLite::OPEN_READWRITE)
      .exec("UPDATE trip SET time_loss_s = 9e999; UPDATE encounter SET min_ttc_s = 9e999, pet_s = -9e999");
  ChildProcess child({"report", Results(), "-o", Page()});
  EXPECT_EQ(child.Wait(), 0) << child.Errors();
  EXPECT_CONTAINS(child.Output(), "PARTIAL");
  const std::string page = ReadFile(Page());
  EXPECT_NE(page.find("seed 2"), std::string::npos);
  EXPECT_NE(page.find("time_loss_s undefined (NULL or not a number)"), std::string::npos);
  const std::size_t data = page.find("id=\"data\"");
  for (const char* bad : {":inf", ",inf", ":nan", "Infinity,"})
    EXPECT_EQ(page.substr(data, page.find("</script>", data) - data).find(bad), std::string::npos) << bad;
}

TEST_F(ReportCli, BadRequestsAreRefusedAndReplaceNothing) {
  ChildProcess missing({"report", Results(), "-o", Page()});
  EXPECT_EQ(missing.Wait(), 2);
  EXPECT_CONTAINS(missing.Errors(), "there is no such file");
  Record("sumo", "1");
  folder_.Write("report.html", "mine");
  ChildProcess existing({"report", Results(), "-o", Page()});
  EXPECT_EQ(existing.Wait(), 2);
  EXPECT_CONTAINS(existing.Errors(), "--force replaces it");
  EXPECT_EQ(ReadFile(Page()), "mine");
  ChildProcess nowhere({"report", Results(), "-o", (folder_ / "nowhere" / "r.html").string()});
  EXPECT_EQ(nowhere.Wait(), 2);
  EXPECT_CONTAINS(nowhere.Errors(), "could not be written");
}

}  // namespace
}  // namespace lanewise
