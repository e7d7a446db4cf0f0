#pragma once

#include <vector>

#include "tests/stability/case.h"

namespace lumifold::stability {

/// All methods, those of filter::Methods() first, each with its default parameters.
const std::vector<Column>& AllColumns();

/// Null if no column has the name.
const Column* FindColumn(const std::string& name);

}  // namespace lumifold::stability
