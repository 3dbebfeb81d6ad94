#include "agents/v2x/inbox.h"

#include <gtest/gtest.h>

#include <map>
#include <random>

namespace lanewise {
namespace {

TEST(Inbox, KeepsTheLastMessageOfEachSender) {
  Inbox inbox;
  EXPECT_FALSE(inbox.Find(7, 0));
  EXPECT_EQ(inbox.Put({7, 1, 1, 0}, 0).sender, kNone);
  EXPECT_EQ(inbox.Put({7, 3, 4, 5}, 0).sent, 1);
  ASSERT_TRUE(inbox.Find(7, 0));
  EXPECT_EQ(inbox.Find(7, 0)->index, 5);
  // One that was overtaken changes nothing.
  EXPECT_EQ(inbox.Put({7, 2, 5, 9}, 0).sent, 3);
  EXPECT_EQ(inbox.Find(7, 0)->sent, 3);
  EXPECT_FALSE(inbox.Find(7, 4)) << "older than what is remembered";
  inbox.Clear();
  EXPECT_FALSE(inbox.Find(7, 0));
}

TEST(Inbox, AgreesWithAMapWhileSendersComeAndGo) {
  constexpr int kMemory = 20;
  Inbox inbox;
  std::map<StationId, Inbox::Entry> reference;
  std::mt19937 random(1);
  for (std::int32_t step = 0; step < 400; ++step) {
    const std::int32_t oldest = step - kMemory;
    for (int k = 0; k < 12; ++k) {
      // Vehicles of a window that moves on, and three roadside units.
      const StationId sender = random() % 5 == 0 ? RoadsideStation(static_cast<int>(random() % 3))
                                                 : step + static_cast<StationId>(random() % 30);
      const Inbox::Entry entry{sender, step - static_cast<std::int32_t>(random() % 4), step, k};
      const Inbox::Entry before = inbox.Put(entry, oldest);
      const auto it = reference.find(sender);
      const bool known = it != reference.end() && it->second.sent >= oldest;
      ASSERT_EQ(before.sender, known ? sender : kNone);
      if (!known || it->second.sent < entry.sent) reference[sender] = entry;
    }
    std::size_t known = 0, visited = 0;
    for (const auto& [sender, entry] : reference) {
      const auto found = inbox.Find(sender, oldest);
      ASSERT_EQ(found.has_value(), entry.sent >= oldest) << "step " << step << " sender " << sender;
      if (!found) continue;
      ++known;
      EXPECT_EQ(found->sent, entry.sent);
      EXPECT_EQ(found->index, entry.index);
    }
    inbox.ForEach(oldest, [&](const Inbox::Entry&) { ++visited; });
    EXPECT_EQ(visited, known);
  }
}

TEST(Inbox, MessagesOnTheirWayLandInOrder) {
  Inbox inbox;
  inbox.Send({1, 0, 2, 0});
  inbox.Send({2, 0, 1, 0});
  inbox.Send({1, 1, 2, 0});
  std::vector<std::int32_t> landed;
  const auto land = [&](const Inbox::Entry& entry) { landed.push_back(10 * entry.sender + entry.sent); };
  inbox.Arrive(1, land);
  EXPECT_EQ(landed, std::vector<std::int32_t>({20}));
  inbox.Arrive(2, land);
  EXPECT_EQ(landed, std::vector<std::int32_t>({20, 10, 11}));
}

}  // namespace
}  // namespace lanewise
