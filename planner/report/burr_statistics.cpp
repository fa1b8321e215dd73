// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/report/burr_statistics.hpp"

#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>

namespace asbuilt {

Equivalence equivalence_to_zero(const std::vector<double>& values, double margin) {
  Equivalence e;
  e.margin = margin;
  std::vector<double> v;
  for (const double x : values)
    if (std::isfinite(x)) v.push_back(x);
  e.count = v.size();
  if (v.size() < 3) return e;
  const double n = static_cast<double>(v.size());
  for (const double x : v) e.mean += x / n;
  double square = 0;
  for (const double x : v) square += (x - e.mean) * (x - e.mean);
  e.sd = std::sqrt(square / (n - 1));
  double together = 1;
  for (std::size_t lag = 1; square > 0 && lag < v.size() / 2; ++lag) {
    double c = 0;
    for (std::size_t i = 0; i + lag < v.size(); ++i) c += (v[i] - e.mean) * (v[i + lag] - e.mean);
    if (c <= 0) break;
    together += 2 * c / square;
  }
  e.count_effective = std::clamp(n / together, 2.0, n);
  e.standard_error = e.sd / std::sqrt(e.count_effective);
  if (e.standard_error <= 0) {
    e.p = std::abs(e.mean) < margin ? 0 : 1;
  } else {
    const boost::math::students_t t(std::max(1.0, e.count_effective - 1));
    e.p = std::max(boost::math::cdf(boost::math::complement(t, (e.mean + margin) / e.standard_error)),
                   boost::math::cdf(boost::math::complement(t, (margin - e.mean) / e.standard_error)));
  }
  e.is_equivalent = e.p < 0.05;
  return e;
}

std::vector<FeatureBurr> burr_by_feature(const Features& features, const Burrs& burrs, double margin_mm) {
  std::vector<FeatureBurr> out;
  std::vector<std::string> names;
  for (const AdaptedEdge& e : features.edges)
    if (std::find(names.begin(), names.end(), e.feature) == names.end()) names.push_back(e.feature);
  for (const std::string& name : names) {
    FeatureBurr f;
    f.feature = name;
    std::vector<double> heights;
    double stations = 0, seen = 0, bare = 0;
    for (std::size_t k = 0; k < features.edges.size() && k < burrs.edges.size(); ++k) {
      if (features.edges[k].feature != name) continue;
      for (const double h : burrs.edges[k].height_mm) {
        stations += 1;
        heights.push_back(h);
        if (!std::isfinite(h)) continue;
        seen += 1, bare += h == 0;
        f.max_mm = std::max(f.max_mm, h);
      }
    }
    f.to_none = equivalence_to_zero(heights, margin_mm);
    f.mean_mm = f.to_none.mean;
    f.seen_ratio = stations > 0 ? seen / stations : 0, f.bare_ratio = seen > 0 ? bare / seen : 0;
    out.push_back(std::move(f));
  }
  return out;
}

}  // namespace asbuilt
