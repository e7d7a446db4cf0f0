#include "server/job/ids.h"

#include <string>

namespace lumifold::job {

JobId MakeJobId(absl::Time now, uint64_t random) {
  static constexpr char kDigits[] = "0123456789abcdefghjkmnpqrstvwxyz";  // in order of their character codes
  constexpr int kBitsPerDigit = 5;
  constexpr int kTimeDigits = 9;
  constexpr int kRandomDigits = 7;  // with 4, two ids of 2500 jobs a second are equal within minutes
  std::string text = "j-";
  const auto append = [&text](uint64_t number, int digits) {
    for (int i = digits - 1; i >= 0; --i) text.push_back(kDigits[number >> i * kBitsPerDigit & 31]);
  };
  append(static_cast<uint64_t>(absl::ToUnixMillis(now)), kTimeDigits);
  append(random, kRandomDigits);
  return JobId(text);
}

}  // namespace lumifold::job
