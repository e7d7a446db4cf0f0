#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/storage/data_folder.h"

namespace lumifold::server {

/// The command of lumifold-server that calls RecoverLedger.
inline constexpr char kRecoverCommand[] = "recover";

/// Errors: kFailedPrecondition, naming the command, where the folder has jobs but no ledger: a coordinator
/// that started anew would forget them.
absl::Status CheckHasLedger(const DataFolder& folder);

/// `status`, with the command that helps if the ledger is malformed.
absl::Status AdviseRecovery(const DataFolder& folder, const absl::Status& status);

/// Builds the SQLite ledger of a data folder anew from the manifests, the unit logs and the results of its
/// jobs. Records, results and manifests that are damaged are left out; their units are rendered again. The
/// old ledger is kept under another name (ledger.db.old-1, ...). A call that is interrupted can be repeated.
/// Returns what was found, in lines for the operator.
/// Errors: kFailedPrecondition where a coordinator uses the folder; kNotFound where it does not exist;
/// kUnavailable naming a file.
absl::StatusOr<std::string> RecoverLedger(const DataFolder& folder);

}  // namespace lumifold::server
