#pragma once

namespace lumifold {

/// EnvironmentMap.uri of the neutral studio that every worker has: no file of a job.
inline constexpr char kStudioUri[] = "studio";

}  // namespace lumifold
