#pragma once

#include <vector>

#include "tests/stability/case.h"

namespace lumifold::stability {

/// Every method there is, ours first, each with its own default parameters.
const std::vector<Column>& AllColumns();

/// Null where none has the name.
const Column* FindColumn(const std::string& name);

}  // namespace lumifold::stability
