#include "client/scene/assets.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include "tests/support/percent_decoding_cases.h"
#include "tests/unit/client/test_environment.h"

namespace lumifold::client {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

constexpr char kEmptySha256[] = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
constexpr char kAbcSha256[] = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

std::string LittleEndian(uint32_t value) {
  std::string bytes;
  for (int i = 0; i < 4; ++i) bytes += static_cast<char>(value >> (8 * i));
  return bytes;
}

std::string Glb(const std::string& json) {
  const auto size = static_cast<uint32_t>(json.size());
  return "glTF" + LittleEndian(2) + LittleEndian(20 + size) + LittleEndian(size) + "JSON" + json;
}

absl::StatusOr<SceneAssets> Find(const std::string& path, const SceneFileRules& rules = {}) {
  absl::StatusOr<SceneAssets> assets = FindSceneAssets(path, rules);
  if (!assets.ok()) return assets;
  if (absl::Status status = HashAssets(rules, &*assets); !status.ok()) return status;
  return assets;
}

absl::Status ErrorOf(const std::string& path) { return Find(path).status(); }

TEST(SceneAssets, NameAMissingScene) {
  const ScratchFolder folder;
  const std::string path = folder.File("room.glb");
  EXPECT_EQ(ErrorOf(path), absl::NotFoundError("scene " + path + ": No such file or directory"));
}

TEST(SceneAssets, RefuseWhatIsNoGltf) {
  const ScratchFolder folder;
  for (const std::string content : {"", "hello", "[1, 2]", "{}", "{\"asset\": ", "glT"}) {
    const std::string path = folder.Write("room.glb", content);
    EXPECT_EQ(ErrorOf(path), absl::DataLossError("scene " + path + ": not a glTF file")) << content;
  }
  const std::string path = folder.File(".");
  EXPECT_EQ(ErrorOf(path), absl::InvalidArgumentError("scene " + path + ": is a folder, not a file"));
}

TEST(SceneAssets, RefuseAGlbThatIsTooShortOrDamaged) {
  const ScratchFolder folder;
  const std::string whole = Glb("{\"asset\":{}}");
  EXPECT_THAT(std::string(ErrorOf(folder.Write("a.glb", whole.substr(0, 14))).message()),
              testing::EndsWith("a.glb: a GLB file that ends within its header"));
  EXPECT_THAT(
      std::string(ErrorOf(folder.Write("b.glb", whole.substr(0, whole.size() - 1))).message()),
      testing::EndsWith("b.glb: a GLB file that is too short: it has 31 of the 32 bytes its header states"));
  std::string version_1 = whole;
  version_1[4] = 1;
  EXPECT_THAT(std::string(ErrorOf(folder.Write("c.glb", version_1)).message()),
              testing::EndsWith("c.glb: glTF version 1; only version 2 is supported"));
  std::string huge_json = whole;
  huge_json.replace(12, 4, LittleEndian(0xffffffff));
  EXPECT_THAT(std::string(ErrorOf(folder.Write("d.glb", huge_json)).message()),
              testing::EndsWith("d.glb: a GLB file whose first chunk is not JSON"));
}

TEST(SceneAssets, NameSceneAndFileWhereAFileIsMissing) {
  const ScratchFolder folder;
  const std::string path =
      folder.Write("room.gltf", R"({"asset":{"version":"2.0"},"images":[{"uri":"wood%20floor.png"}]})");
  EXPECT_EQ(ErrorOf(path),
            absl::NotFoundError("scene " + path + " needs wood floor.png: " + folder.File("wood floor.png") +
                                ": No such file or directory"));
}

TEST(SceneAssets, RefuseUrisThatAreNoFiles) {
  const auto uris = ExternalFiles(R"({"asset":{},"images":[{},{"uri":"https://example.org/a.png"}]})");
  EXPECT_EQ(uris.status(), absl::DataLossError("images[1].uri is 'https://example.org/a.png'; only files and "
                                               "data: URIs are supported"));
}

TEST(SceneAssets, FindEveryFileOnceInOrder) {
  const auto uris =
      ExternalFiles(R"({"asset":{}, "buffers":[{"uri":"b.bin"},{"uri":"data:;base64,AA=="},{"byteLength":3}],
      "images":[{"uri":"a.png"},{"bufferView":0},{"uri":"b.bin"},{"uri":"../c.png"},{"uri":"a.png"}]})");
  EXPECT_THAT(uris.value(), ElementsAre("b.bin", "a.png", "../c.png"));
  EXPECT_THAT(ExternalFiles(R"({"asset":{}})").value(), IsEmpty());
}

TEST(SceneAssets, AreNamedByTheirDecodedUris) {
  const auto files = ExternalFiles(R"({"asset":{}, "images":[{"uri":"a%20b.png"},{"uri":"a b.png"},
      {"uri":"%C3%BC.png"},{"uri":"ü.png"},{"uri":"100%25.png"},{"uri":"100%.png"},{"uri":"%2541.png"}]})");
  EXPECT_THAT(files.value(), ElementsAre("a b.png", "ü.png", "100%.png", "%41.png"));
}

TEST(SceneAssets, RefuseUrisThatDecodeToNoFileName) {
  const auto error = [](const std::string& uri) {
    return std::string(
        ExternalFiles(R"({"asset":{},"buffers":[{"uri":")" + uri + R"("}]})").status().message());
  };
  EXPECT_EQ(error("%FC.png"), "buffers[0].uri is '%FC.png'; decoded, it is not a file name in UTF-8");
  EXPECT_EQ(error("a%00.png"), "buffers[0].uri is 'a%00.png'; decoded, it is not a file name in UTF-8");
  EXPECT_EQ(error("environment%3Asky.exr"),
            "buffers[0].uri is 'environment%3Asky.exr'; names that begin with 'environment:' are reserved");
}

TEST(SceneAssets, HashTheSceneAndItsFilesAlsoInAnAllowedFolder) {
  const ScratchFolder folder;
  folder.Write("textures/wood floor.png", "abc");
  folder.Write("scenes/mesh.bin", "");
  const std::string json = R"({"asset":{"version":"2.0"},"buffers":[{"uri":"mesh.bin"}],)"
                           R"("images":[{"uri":"../textures/wood%20floor.png"}]})";
  for (const std::string& content : {json, Glb(json)}) {
    const std::string path = folder.Write("scenes/room.glb", content);
    const SceneAssets assets = Find(path, {.allowed_folders = {folder.File("textures")}}).value();
    ASSERT_EQ(assets.size(), 3u);
    EXPECT_EQ(assets[0].ref.uri(), "");
    EXPECT_EQ(assets[0].ref.size(), content.size());
    EXPECT_EQ(assets[1].ref.uri(), "mesh.bin");
    EXPECT_EQ(assets[1].ref.sha256(), kEmptySha256);
    EXPECT_EQ(assets[2].ref.uri(), "../textures/wood floor.png");
    EXPECT_EQ(assets[2].ref.sha256(), kAbcSha256);
    EXPECT_EQ(assets[2].ref.size(), 3u);
    const v1::SceneRef scene = MakeSceneRef(assets);
    EXPECT_EQ(scene.display_name(), "room.glb");
    EXPECT_EQ(scene.file().sha256(), assets[0].ref.sha256());
    EXPECT_EQ(scene.dependencies_size(), 2);
  }
}

TEST(SceneAssets, AreWithinTheLimitsBeforeAnyOfThemIsRead) {
  const ScratchFolder folder;
  const std::string path =
      folder.Write("room.gltf", R"({"asset":{"version":"2.0"},"images":[{"uri":"a.png"},{"uri":"b.png"}]})");
  folder.Write("a.png", "abc");
  // Sparse: reading it would take minutes.
  std::filesystem::resize_file(folder.Write("b.png", ""), uint64_t{1} << 40);
  EXPECT_EQ(ErrorOf(path), absl::ResourceExhaustedError(
                               "scene " + path + " needs b.png: " + folder.File("b.png") +
                               ": has 1099511627776 bytes, over the limit of 4294967296 for a file; "
                               "--max-file-mb raises it"));
  EXPECT_EQ(
      Find(path, {.max_file_bytes = uint64_t{2} << 40, .max_job_bytes = 1000}).status(),
      absl::ResourceExhaustedError("scene " + path +
                                   ": its files have 1099511627849 bytes, over the limit of 1000 for a job; "
                                   "--max-job-mb raises it; the largest is " +
                                   folder.File("b.png") + " with 1099511627776"));
}

TEST(SceneAssets, OfTheCommandLineMayBeAnywhereButAreRegularFiles) {
  const ScratchFolder folder;
  const std::string fifo = folder.File("fifo");
  ASSERT_EQ(mkfifo(fifo.c_str(), 0600), 0);
  EXPECT_EQ(ErrorOf(fifo), absl::InvalidArgumentError("scene " + fifo + ": is a FIFO, not a file"));
  EXPECT_EQ(ErrorOf("/dev/zero"), absl::InvalidArgumentError("scene /dev/zero: is a device, not a file"));
  SceneAssets assets = FindSceneAssets(folder.Write("room.gltf", R"({"asset":{}})"), {}).value();
  LocalAsset environment;
  environment.path = "/dev/zero";
  assets.push_back(environment);
  EXPECT_EQ(HashAssets({}, &assets), absl::InvalidArgumentError("--env /dev/zero: is a device, not a file"));
}

TEST(PercentDecoded, AgreesWithTheWorker) {
  for (const auto& [encoded, decoded] : kPercentDecodingCases) EXPECT_EQ(PercentDecoded(encoded), decoded);
}

}  // namespace
}  // namespace lumifold::client
