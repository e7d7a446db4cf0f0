#include "server/job/ids.h"

#include <string>

namespace lumifold::job {

JobId MakeJobId(absl::Time now, uint64_t random) {
  constexpr char kDigits[] = "0123456789abcdefghjkmnpqrstvwxyz";  // in order of their character codes
  constexpr int kRandomBits = 20;
  constexpr int kBitsPerDigit = 5;
  constexpr int kDigitCount = 13;
  uint64_t bits = static_cast<uint64_t>(absl::ToUnixMillis(now)) << kRandomBits;
  bits |= random & ((uint64_t{1} << kRandomBits) - 1);
  std::string text(kDigitCount, '0');
  for (auto digit = text.rbegin(); digit != text.rend(); ++digit, bits >>= kBitsPerDigit)
    *digit = kDigits[bits & 31];
  return JobId("j-" + text);
}

}  // namespace lumifold::job
