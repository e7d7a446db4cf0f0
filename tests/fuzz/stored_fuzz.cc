// What a coordinator finds in its data folder: manifests, whose checksum is made right; cells of the ledger's
// tables; and the pages of its file. Someone, or a failing disk, may have changed any of them.

#include <sqlite3.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>

#include "absl/strings/str_cat.h"
#include "google/protobuf/stubs/logging.h"
#include "proto/rpc/checksum.h"
#include "server/commit/recover.h"
#include "server/ledger/sqlite_job_store.h"
#include "server/storage/data_folder.h"
#include "server/storage/manifest.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/made_up_plan.h"
#include "tests/support/temp_folder.h"

namespace lumifold::fuzz {
namespace {

namespace fs = std::filesystem;
const job::JobId kJob("j-1");

void Write(const std::string& path, std::string_view bytes) {
  std::ofstream(path, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

std::string Read(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

ledger::NewJob SomeJob() {
  v1::JobSpec spec;
  *spec.mutable_plan() = MadeUpPlan();
  spec.mutable_plan()->set_numeric_class("avx2");
  spec.set_width(20);
  spec.set_height(12);
  spec.set_tile_size(8);
  spec.set_samples_per_pixel(10);
  spec.set_pass_samples(4);
  spec.set_frame_count(2);
  spec.mutable_filter()->set_method("default");
  spec.mutable_scene()->mutable_file()->set_sha256(std::string(64, 'a'));
  spec.mutable_scene()->mutable_file()->set_size(3);
  ledger::NewJob job{.id = kJob, .request_id = "r-1", .spec = spec, .submitted = absl::UnixEpoch()};
  job.scheduling.set_user("ann");
  return job;
}

/// The file of a ledger with a job that has units and a finished frame.
std::string MakeLedger() {
  const TempFolder folder(InMemory());
  const std::string path = folder.PathOf("ledger.db");
  {
    const std::unique_ptr<ledger::JobStore> store = *ledger::OpenSqliteJobStore(path);
    ledger::NewJob job = SomeJob();
    if (!store->CreateJob(job).ok()) Fail("cannot create", "a job");
    ledger::JobCommit commit;
    commit.job.job = kJob;
    commit.warnings = {"made up"};
    for (int32_t tile = 0; tile < 4; ++tile) {
      ledger::UnitRecord unit;
      unit.unit = {kJob, {.frame = 1, .tile = tile, .pass = 0, .kind = v1::UNIT_KIND_PASS}};
      unit.attempt = job::Attempt(tile + 1);
      unit.file = "film/j-1/frame-0001.units";
      unit.length = 100;
      commit.units.push_back(unit);
    }
    if (!store->CommitUnits({commit})->front().ok()) Fail("cannot commit", "units");
    if (!store->RecordFrame(commit.job, 0, {}).ok()) Fail("cannot record", "a frame");
  }
  sqlite3* db = nullptr;
  sqlite3_open(path.c_str(), &db);
  sqlite3_exec(db, "PRAGMA wal_checkpoint(TRUNCATE); PRAGMA journal_mode = DELETE;", nullptr, nullptr,
               nullptr);
  sqlite3_close(db);
  return Read(path);
}

const std::string& WholeLedger() {
  static const std::string ledger = MakeLedger();
  return ledger;
}

/// Everything that a coordinator asks a ledger when it starts, and that a client may make it ask.
void UseLedger(const std::string& path) {
  const absl::StatusOr<std::unique_ptr<ledger::JobStore>> opened = ledger::OpenSqliteJobStore(path);
  if (!opened.ok()) return;
  ledger::JobStore& store = **opened;
  (void)store.ListJobs({});
  (void)store.GetJob(kJob);
  const absl::StatusOr<ledger::Epoch> epoch = store.NewEpoch();
  if (epoch.ok()) (void)store.ClaimUnfinishedJobs({.name = "fuzz", .epoch = *epoch});
  (void)store.ForEachUnit(kJob, std::nullopt, [](const ledger::UnitRecord&) {});
  (void)store.FinishedFrames(kJob);
  (void)store.DeliverersOf(kJob);
  (void)store.BlockedWorkers();
  (void)store.CreateJob(SomeJob());
}

struct Column {
  std::string table;
  std::string name;
};

/// All columns of the ledger's tables.
std::vector<Column> MakeColumns() {
  const TempFolder folder(InMemory());
  Write(folder.PathOf("ledger.db"), WholeLedger());
  sqlite3* db = nullptr;
  sqlite3_open(folder.PathOf("ledger.db").c_str(), &db);
  std::vector<Column> columns;
  sqlite3_exec(
      db, "SELECT m.name, c.name FROM sqlite_master m, pragma_table_info(m.name) c WHERE m.type = 'table'",
      [](void* to, int, char** values, char**) {
        static_cast<std::vector<Column>*>(to)->push_back({values[0], values[1]});
        return 0;
      },
      &columns, nullptr);
  sqlite3_close(db);
  if (columns.size() < 10) Fail("the ledger has few columns", std::to_string(columns.size()));
  return columns;
}

/// Puts the bytes into all rows of one column, as a value of one of SQLite's types.
void ChangeColumn(const std::string& path, uint8_t column, uint8_t type, std::string_view bytes) {
  static const std::vector<Column> columns = MakeColumns();
  const Column& changed = columns[column % columns.size()];
  sqlite3* db = nullptr;
  sqlite3_open(path.c_str(), &db);
  sqlite3_stmt* update = nullptr;
  const std::string sql =
      absl::StrCat("UPDATE OR IGNORE \"", changed.table, "\" SET \"", changed.name, "\" = ?");
  if (sqlite3_prepare_v2(db, sql.c_str(), -1, &update, nullptr) == SQLITE_OK) {
    int64_t number = 0;
    double real = 0;
    std::memcpy(&number, bytes.data(), std::min(bytes.size(), sizeof(number)));
    std::memcpy(&real, bytes.data(), std::min(bytes.size(), sizeof(real)));
    const int size = static_cast<int>(bytes.size());
    switch (type % 5) {
      case 0:
        sqlite3_bind_int64(update, 1, number);
        break;
      case 1:
        sqlite3_bind_double(update, 1, real);
        break;
      case 2:
        sqlite3_bind_text(update, 1, bytes.data(), size, SQLITE_TRANSIENT);
        break;
      case 3:
        sqlite3_bind_blob(update, 1, bytes.data(), size, SQLITE_TRANSIENT);
        break;
      default:
        sqlite3_bind_null(update, 1);
    }
    sqlite3_step(update);
  }
  sqlite3_finalize(update);
  sqlite3_close(db);
}

void TryLedger(std::string_view file, std::string_view change) {
  static const TempFolder folder(InMemory());
  const std::string path = folder.PathOf("ledger.db");
  for (const char* suffix : {"", "-wal", "-shm", "-journal"}) fs::remove(path + suffix);
  Write(path, file);
  if (change.size() >= 2) {
    ChangeColumn(path, static_cast<uint8_t>(change[0]), static_cast<uint8_t>(change[1]), change.substr(2));
  }
  UseLedger(path);
}

/// The fields of a manifest as a file with a right checksum; then a ledger is made from it.
void TryManifest(std::string_view message, bool repaired) {
  const TempFolder root(InMemory());
  const server::DataFolder folder(root.PathOf("data"));
  if (!folder.Claim().ok() || !server::MakeFolder(folder.FilmPath(kJob)).ok())
    Fail("cannot make", folder.root());
  const uint64_t checksum = rpc::Checksum(message);
  std::string file = repaired ? "LFM1" + std::string(reinterpret_cast<const char*>(&checksum), 8) : "";
  file.append(message);
  Write(folder.ManifestPath(kJob), file);
  (void)server::ReadManifest(folder.ManifestPath(kJob));
  const absl::StatusOr<std::string> report = server::RecoverLedger(folder);
  if (!report.ok()) Fail("a damaged manifest stops the recovery", std::string(report.status().message()));
  UseLedger(folder.LedgerPath());
}

}  // namespace

std::vector<std::string> Seeds() {
  google::protobuf::SetLogHandler(nullptr);  // it would print a line for each malformed message
  const v1::JobManifest manifest = server::ManifestOf(SomeJob());
  std::vector<std::string> seeds = {"m" + manifest.SerializeAsString(), "l" + WholeLedger()};
  seeds.push_back("f" + std::string("LFM1\0\0\0\0\0\0\0\0", 12) + manifest.SerializeAsString());
  for (char column = 0; column < 60; ++column)
    seeds.push_back(std::string("c") + column + static_cast<char>(column % 5) +
                    SomeJob().spec.SerializeAsString());
  return seeds;
}

}  // namespace lumifold::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace lumifold;
  if (size == 0) return 0;
  const std::string_view rest(reinterpret_cast<const char*>(data) + 1, size - 1);
  switch (data[0]) {
    case 'm':
    case 'f':
      fuzz::TryManifest(rest, data[0] == 'm');
      return 0;
    case 'c':
      fuzz::TryLedger(fuzz::WholeLedger(), rest);
      return 0;
    default:
      fuzz::TryLedger(rest, "");
      return 0;
  }
}
