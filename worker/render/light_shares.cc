#include "worker/render/light_shares.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>

namespace lumifold::render {
namespace {

/// Finite and infinite lights each get at least this fraction of the samples.
constexpr double kMinShare = 0.25;

double SumOf(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return sum;
}

/// `shares` rounded to multiples of 1 / `parts`; those above 0 to one at least.
std::vector<double> InWholeParts(const std::vector<double>& shares, int parts) {
  std::vector<double> whole(shares.size());
  for (size_t i = 0; i < shares.size(); ++i)
    whole[i] = shares[i] > 0 ? std::max(1.0, std::floor(shares[i] * parts)) : 0;
  int left = parts - static_cast<int>(SumOf(whole));
  // One part at a time, to the light that lacks most or from the one that has most to spare.
  for (; left != 0; left += left < 0 ? 1 : -1) {
    const double sign = left < 0 ? -1 : 1;
    size_t best = shares.size();
    double most = 0;
    for (size_t i = 0; i < shares.size(); ++i) {
      if (whole[i] <= (left < 0 ? 1 : 0)) continue;
      const double lack = sign * (shares[i] * parts - whole[i]);
      if (best < shares.size() && lack <= most) continue;
      best = i;
      most = lack;
    }
    whole[best] += sign;
  }
  for (double& share : whole) share /= parts;
  return whole;
}

}  // namespace

bool LightPowers::AllZero() const { return SumOf(finite) + SumOf(infinite) <= 0; }

std::vector<double> LightShares(const LightPowers& powers) {
  const double finite = SumOf(powers.finite);
  const double infinite = SumOf(powers.infinite);
  double finite_share = finite > 0 ? finite / (finite + infinite) : 0;
  if (finite > 0 && infinite > 0) finite_share = std::clamp(finite_share, kMinShare, 1 - kMinShare);
  std::vector<double> shares;
  for (const double power : powers.finite) shares.push_back(finite > 0 ? power / finite * finite_share : 0);
  for (const double power : powers.infinite)
    shares.push_back(infinite > 0 ? power / infinite * (1 - finite_share) : 0);
  const auto lights = std::count_if(shares.begin(), shares.end(), [](double share) { return share > 0; });
  if (lights == 0 || lights > kFewLights) return shares;
  return InWholeParts(shares, 4 * static_cast<int>(std::bit_ceil(static_cast<unsigned>(lights))));
}

}  // namespace lumifold::render
