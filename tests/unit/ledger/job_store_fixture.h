#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "server/ledger/job_store.h"

namespace lumifold::ledger {

/// An empty database that a JobStore can be opened in more than once.
class Database {
 public:
  virtual ~Database() = default;
  virtual absl::StatusOr<std::unique_ptr<JobStore>> Open() = 0;
};

/// A kind of database; nullptr from `make`, with a message in `why_not`, where this machine has none.
struct DatabaseKind {
  std::string name;
  std::function<std::unique_ptr<Database>(std::string* why_not)> make;

  friend void PrintTo(const DatabaseKind& kind, std::ostream* out) { *out << kind.name; }
};

/// Kinds of databases that every JobStore test runs with.
std::vector<DatabaseKind> DatabaseKinds();

inline const absl::Time kStart = absl::FromUnixMillis(1'700'000'000'123);

inline OwnedJob Owned(const std::string& job, int64_t epoch = 1) { return {job::JobId(job), Epoch(epoch)}; }

/// A job of the coordinator of epoch 1.
NewJob Job(const std::string& id, const std::string& request_id);

/// A unit that was leased in epoch 1.
UnitRecord Unit(const std::string& job, int32_t frame, int32_t tile, int32_t pass,
                v1::UnitKind kind = v1::UNIT_KIND_PASS);

JobCommit Commit(const std::string& job, std::vector<UnitRecord> units, int64_t epoch = 1);

class JobStoreTest : public ::testing::TestWithParam<DatabaseKind> {
 protected:
  void SetUp() override;
  /// Closes the store and opens it again.
  void Reopen();

  /// Commits the units of one job and returns the outcome.
  absl::Status CommitOne(const JobCommit& commit);
  std::vector<UnitRecord> Units(const std::string& job, std::optional<int32_t> frame = std::nullopt);
  JobRecord Get(const std::string& job);
  /// Ids of the jobs that are listed.
  std::vector<std::string> Listed(const JobFilter& filter);

  std::unique_ptr<Database> database_;
  std::unique_ptr<JobStore> store_;
};

}  // namespace lumifold::ledger
