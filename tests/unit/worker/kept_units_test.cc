#include "worker/finish/kept_units.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <string>
#include <vector>

#include "tests/unit/worker/worker_rig.h"

namespace lumifold::worker {
namespace {

film::EncodedUnit Record(const std::string& job, int32_t frame, const std::string& bytes) {
  film::EncodedUnit unit;
  unit.unit = {job::JobId(job), {frame, 0, 0, v1::UNIT_KIND_PASS}};
  unit.head = bytes;
  return unit;
}

v1::UnitId Frame(const std::string& job, int32_t frame) {
  v1::UnitId unit;
  unit.set_job_id(job);
  unit.set_frame(frame);
  return unit;
}

/// Bytes of what is kept of the frame; -1: nothing.
int64_t SizeOf(KeptUnits& kept, const std::string& job, int32_t frame) {
  const absl::StatusOr<rpc::FileHandle> file = kept.Open(Frame(job, frame));
  struct stat info = {};
  return file.ok() && fstat(file->get(), &info) == 0 ? info.st_size : -1;
}

TEST(KeptUnits, KeepsTheRecordsOfEachFrameUntilTheyAreDropped) {
  KeptUnits kept;
  EXPECT_EQ(SizeOf(kept, "j-1", 3), -1);
  for (const int32_t frame : {3, 3, 4}) ASSERT_TRUE(kept.Add(Record("j-1", frame, "12345")).ok());
  ASSERT_TRUE(kept.Add(Record("j-2", 3, "123")).ok());
  EXPECT_EQ(SizeOf(kept, "j-1", 3), 10);
  EXPECT_EQ(SizeOf(kept, "j-1", 4), 5);
  kept.Drop(Frame("j-1", 3));
  EXPECT_EQ(SizeOf(kept, "j-1", 3), -1);
  kept.DropJob("j-1");
  EXPECT_EQ(SizeOf(kept, "j-1", 4), -1);
  EXPECT_EQ(SizeOf(kept, "j-2", 3), 3);
  kept.Clear();
  EXPECT_EQ(SizeOf(kept, "j-2", 3), -1);
  ASSERT_TRUE(kept.Add(Record("j-2", 3, "12")).ok());
  EXPECT_EQ(SizeOf(kept, "j-2", 3), 2) << "it begins anew";
}

TEST(LeaseRunner, KeepsTheRecordOfAUnitAndTellsWhatIsCounted) {
  Rig rig;
  v1::CoordinatorMessage grant = Grant(2);
  grant.mutable_grant()->mutable_leases(0)->set_keep(true);
  grant.mutable_grant()->mutable_leases(0)->mutable_unit()->set_kind(v1::UNIT_KIND_GEOMETRY);
  grant.mutable_grant()->mutable_leases(0)->set_last_sample(0);
  grant.mutable_grant()->mutable_leases(1)->set_keep(true);
  rig.worker->OnMessage(grant);
  const std::vector<v1::WorkerMessage> messages = rig.outbox->Await(2);
  for (size_t i = 0; i < 2; ++i) {
    ASSERT_TRUE(messages[i].has_kept()) << messages[i].ShortDebugString();
    EXPECT_EQ(messages[i].kept().attempt(), static_cast<int64_t>(i) + 1);
    EXPECT_GT(messages[i].kept().record_bytes(), 1000);
    EXPECT_FALSE(messages[i].kept().stats().has_camera());
  }
  EXPECT_EQ(messages[1].kept().stats().samples(), 16 * 16 * 2);
}

}  // namespace
}  // namespace lumifold::worker
