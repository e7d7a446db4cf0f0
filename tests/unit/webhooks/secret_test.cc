#include "server/webhooks/secret.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <thread>
#include <vector>

#include "tests/support/temp_folder.h"

namespace lumifold::webhooks {
namespace {

using absl::StatusCode;

TEST(WebhookSecret, IsMadeOnceForAllWhoShareTheFolder) {
  const TempFolder folder;
  const std::string path = folder.PathOf("webhook.secret");
  std::vector<std::string> secrets(8);
  std::vector<std::thread> threads;
  threads.reserve(secrets.size());
  for (std::string& secret : secrets)
    threads.emplace_back([&secret, &path] { secret = ReadOrMakeSecret(path).value_or("none"); });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(secrets.front().size(), 64u);
  for (const std::string& secret : secrets) EXPECT_EQ(secret, secrets.front());
  struct stat info = {};
  ASSERT_EQ(stat(path.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777, mode_t{0600});
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1);
}

TEST(WebhookSecret, IsTheFirstLineOfAFileThatOthersCannotRead) {
  const TempFolder folder;
  const std::string path = folder.PathOf("secret");
  EXPECT_EQ(ReadSecret(path).status().code(), StatusCode::kNotFound);
  using std::filesystem::perms;
  constexpr perms kOfOwner = perms::owner_read | perms::owner_write;
  std::ofstream(path) << "a secret of the operator \nsecond line\n";
  std::filesystem::permissions(path, kOfOwner | perms::group_read);
  EXPECT_EQ(ReadSecret(path).status().code(), StatusCode::kFailedPrecondition);
  std::filesystem::permissions(path, kOfOwner);
  EXPECT_EQ(*ReadSecret(path), "a secret of the operator");
  std::ofstream(path) << "short\n";
  EXPECT_EQ(ReadSecret(path).status().code(), StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace lumifold::webhooks
