#pragma once

namespace lumifold::charts {

/// Seconds of processor time this process has used, all its threads together. What charts call time: unlike
/// the clock on the wall it does not grow while other programs have the processor.
double CpuSeconds();

}  // namespace lumifold::charts
