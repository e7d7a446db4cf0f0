#include "filter/baselines/baseline.h"

#include "filter/baselines/a_trous.h"
#include "filter/baselines/bilateral.h"
#include "filter/baselines/guided.h"
#include "filter/baselines/manifolds_color.h"
#include "filter/baselines/nfor.h"
#include "filter/baselines/non_local_means.h"
#include "filter/baselines/paper.h"

namespace lumifold::filter {

const std::vector<Baseline>& Baselines() {
  static const std::vector<Baseline> baselines = {
      PaperBaseline(),          ManifoldsColorBaseline(), BilateralBaseline(),
      CrossBilateralBaseline(), ATrousBaseline(),         ATrousVarianceBaseline(),
      GuidedBaseline(),         NonLocalMeansBaseline(),  NforBaseline(),
  };
  return baselines;
}

}  // namespace lumifold::filter
