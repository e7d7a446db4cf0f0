#pragma once

#include <string>

namespace lumifold {

/// Makes every call of the protocol with tricks in each of its texts, and prints how many calls gave which code. Returns
/// false where a call gets no answer.
bool SendHostileTexts(const std::string& server);

}  // namespace lumifold
