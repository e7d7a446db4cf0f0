#include "server/page/zip_writer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace lumifold::page {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

TEST(ZipWriter, StoresMembersAndListsThem) {
  ZipWriter zip;
  std::string archive = zip.Begin("a.exr", 9);
  EXPECT_THAT(archive, StartsWith("PK\x03\x04"));
  EXPECT_EQ(archive.size(), 30U + 5);
  for (const std::string piece : {"12345", "6789"}) {
    zip.Add(piece);
    archive += piece;
  }
  archive += zip.End();
  // The check value of CRC-32, in the descriptor and in the directory.
  const std::string crc = "\x26\x39\xf4\xcb";
  EXPECT_THAT(archive, HasSubstr("PK\x07\x08" + crc + std::string("\x09\0\0\0\x09\0\0\0", 8)));
  EXPECT_THAT(archive, HasSubstr(crc + std::string("\x09\0\0\0\x09\0\0\0\x05\0", 10)));
  EXPECT_THAT(archive, Not(HasSubstr("PK\x06\x06")));
  EXPECT_EQ(archive.size(), 35U + 9 + 16 + (46 + 5) + 22);
}

TEST(ZipWriter, LargeMembersHaveFieldsOf64Bits) {
  ZipWriter zip;
  const uint64_t size = uint64_t{5} << 30;
  EXPECT_EQ(zip.Begin("a", size).size(), 30U + 1 + 20);
  const std::string end = zip.End();  // of a member whose bytes were left out
  const std::string size_bytes("\0\0\0\x40\x01\0\0\0", 8);
  EXPECT_THAT(end, StartsWith("PK\x07\x08"));
  EXPECT_THAT(end, HasSubstr(std::string("\x01\0\x10\0", 4) + size_bytes + size_bytes));
}

TEST(ZipWriter, AnArchiveMayBeEmpty) { EXPECT_EQ(ZipWriter().End().size(), 22U); }

}  // namespace
}  // namespace lumifold::page
