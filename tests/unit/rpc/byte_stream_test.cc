#include "proto/rpc/byte_stream.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <vector>

#include "proto/rpc/limits.h"
#include "tests/support/temp_folder.h"

namespace lumifold::rpc {
namespace {

using ::testing::HasSubstr;

std::string Content(size_t size) {
  std::string bytes(size, '\0');
  for (size_t i = 0; i < size; ++i) bytes[i] = static_cast<char>(i * 2654435761u >> 13);
  return bytes;
}

void Write(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

std::string Read(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::vector<v1::ByteChunk> Send(const std::string& path, uint64_t offset) {
  absl::StatusOr<ByteSender> sender = ByteSender::Open(path, offset);
  EXPECT_TRUE(sender.ok()) << sender.status();
  std::vector<v1::ByteChunk> chunks;
  v1::ByteChunk chunk;
  while (sender.ok()) {
    const absl::StatusOr<bool> has_next = sender->Next(&chunk);
    EXPECT_TRUE(has_next.ok()) << has_next.status();
    if (!has_next.ok() || !*has_next) break;
    chunks.push_back(chunk);
  }
  return chunks;
}

TEST(ByteStream, CopiesFilesOfAllSizes) {
  TempFolder folder;
  for (const size_t size :
       {size_t{0}, size_t{1}, kMaxChunkBytes - 1, kMaxChunkBytes, 2 * kMaxChunkBytes + 5}) {
    const std::string from = folder.PathOf("from");
    const std::string to = folder.PathOf("to");
    Write(from, Content(size));
    absl::StatusOr<ByteReceiver> receiver = ByteReceiver::Open(to, 0);
    ASSERT_TRUE(receiver.ok());
    EXPECT_FALSE(receiver->IsComplete());
    for (const v1::ByteChunk& chunk : Send(from, 0)) ASSERT_TRUE(receiver->Add(chunk).ok());
    EXPECT_TRUE(receiver->IsComplete());
    EXPECT_TRUE(receiver->Sync().ok());
    EXPECT_EQ(Read(to), Content(size));
  }
}

TEST(ByteStream, GoesOnWhereItStopped) {
  TempFolder folder;
  const std::string content = Content(3 * kMaxChunkBytes);
  const std::string from = folder.PathOf("from");
  const std::string to = folder.PathOf("to");
  Write(from, content);
  Write(to, content.substr(0, 1'234'567) + "torn");
  absl::StatusOr<ByteReceiver> receiver = ByteReceiver::Open(to, 1'234'567);
  ASSERT_TRUE(receiver.ok());
  for (const v1::ByteChunk& chunk : Send(from, 1'234'567)) ASSERT_TRUE(receiver->Add(chunk).ok());
  EXPECT_TRUE(receiver->IsComplete());
  EXPECT_EQ(Read(to), content);
}

TEST(ByteStream, AtTheEndOneEmptyChunkTellsTheSize) {
  TempFolder folder;
  Write(folder.PathOf("from"), Content(100));
  const std::vector<v1::ByteChunk> chunks = Send(folder.PathOf("from"), 100);
  ASSERT_EQ(chunks.size(), 1u);
  EXPECT_EQ(chunks[0].data(), "");
  EXPECT_EQ(chunks[0].total_size(), 100u);
}

TEST(ByteStream, OffsetPastTheEndIsOutOfRange) {
  TempFolder folder;
  Write(folder.PathOf("from"), Content(100));
  EXPECT_EQ(ByteSender::Open(folder.PathOf("from"), 101).status().code(), absl::StatusCode::kOutOfRange);
  EXPECT_EQ(ByteSender::Open(folder.PathOf("none"), 0).status().code(), absl::StatusCode::kNotFound);
}

TEST(ByteStream, AFileThatBecomesShorterWhileItIsSentIsDataLoss) {
  TempFolder folder;
  const std::string from = folder.PathOf("from");
  for (const size_t left : {size_t{0}, kMaxChunkBytes, 2 * kMaxChunkBytes - 1}) {
    Write(from, Content(2 * kMaxChunkBytes));
    absl::StatusOr<ByteSender> sender = ByteSender::Open(from, 0);
    ASSERT_TRUE(sender.ok());
    v1::ByteChunk chunk;
    ASSERT_TRUE(*sender->Next(&chunk));
    std::filesystem::resize_file(from, left);
    EXPECT_EQ(sender->Next(&chunk).status().code(), absl::StatusCode::kDataLoss) << left;
  }
}

TEST(ByteStream, ReceiverRefusesWhatDoesNotFitAndWritesNothingOfIt) {
  TempFolder folder;
  Write(folder.PathOf("from"), Content(100));
  const v1::ByteChunk good = Send(folder.PathOf("from"), 0).front();
  absl::StatusOr<ByteReceiver> receiver = ByteReceiver::Open(folder.PathOf("to"), 0);
  ASSERT_TRUE(receiver.ok());
  v1::ByteChunk bad = good;
  bad.set_offset(1);
  EXPECT_THAT(std::string(receiver->Add(bad).message()), HasSubstr("piece at 1, expected at 0"));
  bad = good;
  bad.set_checksum(good.checksum() ^ 1);
  EXPECT_EQ(receiver->Add(bad).code(), absl::StatusCode::kDataLoss);
  bad = good;
  bad.set_total_size(99);
  EXPECT_THAT(std::string(receiver->Add(bad).message()), HasSubstr("too long"));
  bad = good;
  bad.clear_data();
  EXPECT_THAT(std::string(receiver->Add(bad).message()), HasSubstr("is empty"));
  bad = good;
  bad.set_data(std::string(kMaxChunkBytes + 1, 'x'));
  bad.set_total_size(kMaxChunkBytes + 1);
  EXPECT_THAT(std::string(receiver->Add(bad).message()), HasSubstr("too long"));
  EXPECT_EQ(Read(folder.PathOf("to")), "");
  EXPECT_EQ(receiver->Sync().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_TRUE(receiver->Add(good).ok());
}

TEST(ByteStream, TotalSizeMustNotChange) {
  TempFolder folder;
  Write(folder.PathOf("from"), Content(2 * kMaxChunkBytes));
  std::vector<v1::ByteChunk> chunks = Send(folder.PathOf("from"), 0);
  absl::StatusOr<ByteReceiver> receiver = ByteReceiver::Open(folder.PathOf("to"), 0);
  ASSERT_TRUE(receiver->Add(chunks[0]).ok());
  chunks[1].set_total_size(3 * kMaxChunkBytes);
  EXPECT_THAT(std::string(receiver->Add(chunks[1]).message()), HasSubstr("total size changed"));
}

}  // namespace
}  // namespace lumifold::rpc
