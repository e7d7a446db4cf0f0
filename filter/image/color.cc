#include "filter/image/color.h"

#include "filter/image/portable_math.h"

namespace lumifold {

float SrgbFromLinear(float linear) {
  if (!(linear > 0)) return 0;
  if (linear >= 1) return 1;
  if (linear <= 0.0031308f) return 12.92f * linear;
  return 1.055f * Pow(linear, 1.0f / 2.4f) - 0.055f;
}

float LinearFromSrgb(float encoded) {
  if (!(encoded > 0)) return 0;
  if (encoded >= 1) return 1;
  if (encoded <= 0.04045f) return encoded / 12.92f;
  return Pow((encoded + 0.055f) / 1.055f, 2.4f);
}

}  // namespace lumifold
