#pragma once

#include <cstddef>
#include <cstdint>

/// Limits of a submission and of what is kept of a job, in one place. NormaliseJobSpec checks those of a spec.
namespace lumifold::job {

/// Maximum number of warnings that are stored for a job; further ones are counted. Each has at most
/// rpc::kMaxWarningBytes, so a job's status has at most 51 KiB of them.
inline constexpr int kMaxJobWarnings = 100;

}  // namespace lumifold::job
