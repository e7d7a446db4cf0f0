#include "server/job/ids.h"

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"

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

std::string TextOf(WorkerId worker) { return absl::StrCat("w-", worker.value()); }

std::optional<WorkerId> ParseWorkerId(absl::string_view text) {
  absl::string_view digits = text;
  int64_t number = 0;
  if (!absl::ConsumePrefix(&digits, "w-") || !absl::SimpleAtoi(digits, &number)) return std::nullopt;
  const WorkerId worker(number);
  if (TextOf(worker) != text) return std::nullopt;  // a sign, or zeros before it
  return worker;
}

}  // namespace lumifold::job
