#include "client/scene/scene_folder.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <atomic>
#include <cstring>
#include <filesystem>
#include <thread>

#include "client/scene/assets.h"
#include "tests/unit/client/test_environment.h"

namespace lumifold::client {
namespace {

namespace fs = std::filesystem;
using testing::EndsWith;
using testing::HasSubstr;

std::string ContentOf(const absl::StatusOr<rpc::FileHandle>& file) {
  if (!file.ok()) return std::string(file.status().ToString());
  char buffer[64];
  const ssize_t n = read(file->get(), buffer, sizeof(buffer));
  return {buffer, static_cast<size_t>(std::max<ssize_t>(n, 0))};
}

/// show/scene/ with the scene, show/library/ beside it, and a secret outside.
class SceneFolderTest : public testing::TestWithParam<Containment> {
 protected:
  SceneFolderTest() {
    files_.Write("show/scene/room.gltf", "{}");
    files_.Write("show/scene/a.png", "inside");
    files_.Write("show/scene/deep/b.png", "deep");
    files_.Write("show/library/wood.png", "library");
    files_.Write("secret", "secret");
  }

  absl::StatusOr<rpc::FileHandle> OpenFile(const std::string& name,
                                           const std::vector<std::string>& allowed = {}) const {
    absl::StatusOr<SceneFolder> folder =
        SceneFolder::Open(files_.File("show/scene/room.gltf"), allowed, GetParam());
    if (!folder.ok()) return folder.status();
    return folder->OpenFile(name);
  }
  void Link(const std::string& target, const std::string& name) const {
    fs::create_symlink(target, files_.File(name));
  }

  const ScratchFolder files_;
};

TEST_P(SceneFolderTest, OpensFilesAtOrBelowIt) {
  EXPECT_EQ(ContentOf(OpenFile("a.png")), "inside");
  EXPECT_EQ(ContentOf(OpenFile("./a.png")), "inside");
  EXPECT_EQ(ContentOf(OpenFile("deep//b.png")), "deep");
  EXPECT_EQ(OpenFile("none.png").status(),
            absl::NotFoundError(files_.File("show/scene/none.png") + ": No such file or directory"));
}

TEST_P(SceneFolderTest, NothingLeadsOut) {
  Link("../../secret", "show/scene/link.png");
  Link(files_.File("secret"), "show/scene/absolute.png");
  Link("..", "show/scene/up");
  Link("/", "show/scene/root");
  Link("/proc/self/root/etc/passwd", "show/scene/magic");
  for (const std::string name :
       {"../../secret", "deep/../../../secret", "link.png", "absolute.png", "up/../secret", "root/etc/passwd",
        "root/etc/no such file", "magic", "../library/wood.png"}) {
    const absl::Status status = OpenFile(name).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kPermissionDenied) << name << ": " << status;
    EXPECT_THAT(std::string(status.message()),
                EndsWith(": is outside the scene's folder; --allow-dir DIR allows another folder"));
  }
}

TEST_P(SceneFolderTest, AllowedFoldersMayBeReachedByAnyPathAndNoOthers) {
  Link(files_.File("show/library"), "show/scene/textures");
  Link("../../secret", "show/library/out.png");
  const std::vector<std::string> allowed = {files_.File("show/library")};
  EXPECT_EQ(ContentOf(OpenFile("../library/wood.png", allowed)), "library");
  EXPECT_EQ(ContentOf(OpenFile("textures/wood.png", allowed)), "library");
  EXPECT_EQ(OpenFile("textures/none.png", allowed).status().code(), absl::StatusCode::kNotFound);
  for (const std::string name :
       {"../../secret", "textures/out.png", "../library/out.png", "../library/../../secret"})
    EXPECT_EQ(OpenFile(name, allowed).status().code(), absl::StatusCode::kPermissionDenied) << name;
  EXPECT_THAT(std::string(OpenFile("a.png", {"/none/such"}).status().message()),
              testing::StartsWith("--allow-dir /none/such: "));
}

TEST_P(SceneFolderTest, OpensRegularFilesOnly) {
  ASSERT_EQ(mkfifo(files_.File("show/scene/fifo").c_str(), 0600), 0);
  const int bound = socket(AF_UNIX, SOCK_STREAM, 0);
  sockaddr_un address = {.sun_family = AF_UNIX, .sun_path = {}};
  std::strncpy(address.sun_path, files_.File("show/scene/socket").c_str(), sizeof(address.sun_path) - 1);
  ASSERT_EQ(bind(bound, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
  close(bound);
  EXPECT_THAT(std::string(OpenFile("fifo").status().message()), EndsWith("fifo: is a FIFO, not a file"));
  EXPECT_THAT(std::string(OpenFile("socket").status().message()),
              EndsWith("socket: is a socket, not a file"));
  EXPECT_THAT(std::string(OpenFile("deep").status().message()), EndsWith("deep: is a folder, not a file"));
  EXPECT_THAT(std::string(OpenFile("zero", {"/dev"}).status().message()), HasSubstr("No such file"));
  if (GetParam() == Containment::kByComponents) return;
  Link("/dev/zero", "show/scene/zero");
  EXPECT_THAT(std::string(OpenFile("zero", {"/dev"}).status().message()),
              EndsWith("zero: is a device, not a file"));
}

// Someone who may write into the scene's folder exchanges a file and a link to the secret all the time.
TEST_P(SceneFolderTest, IsNotDeceivedByALinkThatComesAndGoes) {
  Link("../../secret", "show/scene/link");
  std::atomic<bool> ended{false};
  std::thread attacker([&] {
    const std::string file = files_.File("show/scene/a.png");
    const std::string link = files_.File("show/scene/link");
    while (!ended) renameat2(AT_FDCWD, file.c_str(), AT_FDCWD, link.c_str(), RENAME_EXCHANGE);
  });
  const SceneFolder folder = SceneFolder::Open(files_.File("show/scene/room.gltf"), {}, GetParam()).value();
  int opened = 0;
  int refused = 0;
  for (int i = 0; i < 20000 && (i < 2000 || opened == 0 || refused == 0); ++i) {
    const absl::StatusOr<rpc::FileHandle> file = folder.OpenFile("a.png");
    (file.ok() ? opened : refused) += 1;
    if (file.ok()) {
      ASSERT_EQ(ContentOf(file), "inside");
    }
  }
  ended = true;
  attacker.join();
  EXPECT_GT(opened, 0);
  EXPECT_GT(refused, 0);
}

INSTANTIATE_TEST_SUITE_P(, SceneFolderTest,
                         testing::Values(Containment::kOfKernel, Containment::kByComponents),
                         [](const auto& of) {
                           return of.param == Containment::kOfKernel ? "OfKernel" : "ByComponents";
                         });

/// The error of a scene that names a file by this URI, written as in JSON.
std::string ErrorOfUri(const std::string& uri) {
  return std::string(ExternalFiles(R"({"asset":{},"images":[{"uri":")" + uri + R"("}]})").status().message());
}

TEST(FileNames, OfAScenesUrisAreRelativeAndPlain) {
  EXPECT_EQ(ErrorOfUri("/etc/passwd"), "images[0].uri is '/etc/passwd'; absolute paths are not followed");
  EXPECT_EQ(ErrorOfUri("%2fetc/passwd"), "images[0].uri is '%2fetc/passwd'; absolute paths are not followed");
  EXPECT_EQ(ErrorOfUri("//host/share"), "images[0].uri is '//host/share'; absolute paths are not followed");
  EXPECT_EQ(ErrorOfUri("file:///etc/passwd"),
            "images[0].uri is 'file:///etc/passwd'; only files and data: URIs are supported");
  EXPECT_EQ(ErrorOfUri("C:/a.png"), "images[0].uri is 'C:/a.png'; it begins with a drive letter");
  EXPECT_EQ(ErrorOfUri("..\\\\a.png"),
            "images[0].uri is '..\\a.png'; it has a backslash; glTF separates folders by '/'");
  EXPECT_THAT(ErrorOfUri("..%5Ca.png"), HasSubstr("it has a backslash"));
  EXPECT_THAT(ErrorOfUri("a%00.png"), HasSubstr("not a file name in UTF-8"));
  EXPECT_THAT(ErrorOfUri("%c0%ae%c0%ae/a.png"), HasSubstr("not a file name in UTF-8"));  // overlong dots
  EXPECT_THAT(ErrorOfUri("%ed%a0%80.png"), HasSubstr("not a file name in UTF-8"));       // half a surrogate
  EXPECT_EQ(ErrorOfUri("a\\nb.png"), "images[0].uri is 'a\\nb.png'; it has control characters");
  EXPECT_THAT(ErrorOfUri("a%1b[2J.png"), HasSubstr("it has control characters"));
  EXPECT_THAT(ErrorOfUri("gnp.%E2%80%AEexe"),
              HasSubstr("it has control characters"));  // right-to-left override
  EXPECT_THAT(ErrorOfUri(std::string(1025, 'a')), HasSubstr("...'; it has more than 1024 bytes"));
  EXPECT_LT(ErrorOfUri(std::string(100000, 'a')).size(), 200u);
  EXPECT_EQ(ErrorOfUri("%252e%252e/ok.png"), "");  // decoded once: a folder called %2e%2e
  EXPECT_EQ(ErrorOfUri("日本/木.png"), "");
}

}  // namespace
}  // namespace lumifold::client
