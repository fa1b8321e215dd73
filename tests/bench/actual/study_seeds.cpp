// SPDX-License-Identifier: GPL-3.0-or-later
// Seeds of every kind of virtual part through measuring and gate: one line a run, one a kind.
//   study_seeds [--parts ring,bracket,casting,freeform] [--from 1] [--count 20] [--cache DIR] [--light] [--verbose] [--dump]
#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <sstream>

#include "tests/bench/actual/study.hpp"

using namespace asbuilt;
using study::quantile;

namespace {

struct Sum {
  std::vector<double> edge, floor, drawn, z2, z2_1, z2_2, z_m, run_p95_excess;
  double within = 0, within_floor = 0, within_drawn = 0, unseen = 0, count = 0;
  std::vector<double> burr, burr_rel;
  double burr_sum = 0, burr_true_sum = 0;
  std::vector<double> upper_over, burr_true, burr_measured, width, width_ratio, burr_z2;
  double above = 0, above_found = 0, bare = 0, bare_alarm = 0, upper_ok = 0, upper_count = 0;
  int runs = 0, planned = 0;

  void add(const study::Run& r) {
    ++runs, planned += r.is_planned();
    std::vector<double> e, f;
    for (const study::Station& s : r.stations) {
      ++count;
      if (!s.is_seen) { ++unseen; continue; }
      e.push_back(s.error_mm), f.push_back(s.floor_mm);
      drawn.push_back(s.drawn_mm), z2.push_back(s.z2), z2_1.push_back(s.z2_1), z2_2.push_back(s.z2_2), z_m.push_back(s.z_m);
      within += s.is_within, within_floor += s.is_within_floor, within_drawn += s.is_within_drawn;
      if (!std::isfinite(s.burr_mm)) continue;
      burr.push_back(s.burr_mm - s.burr_true_mm);
      burr_true.push_back(s.burr_true_mm), burr_measured.push_back(s.burr_mm);
      if (s.burr_true_mm > s.detection_mm) ++above, above_found += s.burr_mm > 0;
      if (!s.is_burr_near) ++bare, bare_alarm += s.burr_mm > 0;
      ++upper_count, upper_ok += s.burr_true_mm <= s.burr_upper_mm + 1e-9, upper_over.push_back(s.burr_upper_mm - s.burr_true_mm);
      if (s.burr_true_mm > 0.1 && s.width_mm > 0) width.push_back(s.width_mm - s.width_true_mm), width_ratio.push_back(s.width_mm / s.width_true_mm);
      if (s.burr_true_mm > 0.1) burr_z2.push_back(std::pow((s.burr_mm - s.burr_true_mm) / std::max(1e-3, s.burr_sd_mm), 2));
    }
    if (!e.empty()) run_p95_excess.push_back(quantile(e, 0.95) - quantile(f, 0.95));
    edge.insert(edge.end(), e.begin(), e.end()), floor.insert(floor.end(), f.begin(), f.end());
  }
};

double mean(const std::vector<double>& v) {
  double s = 0;
  for (double x : v) s += x / static_cast<double>(v.size());
  return v.empty() ? std::nan("") : s;
}
double rms(const std::vector<double>& v) {
  double s = 0;
  for (double x : v) s += x * x / static_cast<double>(v.size());
  return std::sqrt(s);
}
double sd(const std::vector<double>& v) { const double m = mean(v); double s = 0; for (double x : v) s += (x - m) * (x - m) / static_cast<double>(v.size()); return std::sqrt(s); }
double share(const std::vector<double>& v, double limit) {
  double n = 0;
  for (double x : v) n += x <= limit;
  return n / static_cast<double>(v.size());
}

std::string line(const std::string& name, const Sum& s) {
  const double n = std::max(1.0, static_cast<double>(s.edge.size()));
  return fmt::format("{:14} p95 {:.3f} floor {:.3f} drawn {:.3f} | chamfer {:5.1f} floor {:5.1f} drawn {:5.1f} % | z2 {:5.2f} ({:.2f} {:.2f}) in95 {:5.1f} % m {:5.1f} % | burr rms {:.3f} bias {:+.3f} z2 {:4.1f} up {:5.1f} %",
                     name, quantile(s.edge, 0.95), quantile(s.floor, 0.95), quantile(s.drawn, 0.95), 100 * s.within / n, 100 * s.within_floor / n, 100 * s.within_drawn / n, mean(s.z2), mean(s.z2_1), mean(s.z2_2),
                     100 * share(s.z2, 5.991), 100 * (share(s.z_m, 1.96) - share(s.z_m, -1.96)), rms(s.burr), mean(s.burr), mean(s.burr_z2), 100 * s.upper_ok / std::max(1.0, s.upper_count));
}

}  // namespace

int main(int argc, char** argv) {
  std::string parts = "ring,bracket,casting,freeform", cache = "study_cache", one;
  int from = 1, count = 20;
  bool is_light = false, is_verbose = false, is_dump = false;
  for (int i = 1; i < argc; ++i) {
    const std::string a = argv[i];
    const auto next = [&] { return std::string(i + 1 < argc ? argv[++i] : ""); };
    if (a == "--parts") parts = next();
    else if (a == "--from") from = std::stoi(next());
    else if (a == "--count") count = std::stoi(next());
    else if (a == "--cache") cache = next();
    else if (a == "--light") is_light = true;
    else if (a == "--verbose") is_verbose = true;
    else if (a == "--dump") is_verbose = is_dump = true;
  }
  std::vector<std::string> table;
  Sum all;
  std::stringstream list(parts);
  while (std::getline(list, one, ',')) {
    Sum sum;
    for (int seed = from; seed < from + count; ++seed) {
      Scenario sc;
      sc.part = one, sc.seed = static_cast<std::uint64_t>(seed), sc.is_light = is_light;
      const study::Run r = study::run(sc, {.cache = cache});
      Sum single;
      single.add(r), sum.add(r), all.add(r);
      std::string times;
      for (const auto& [name, t] : r.time_s) times += fmt::format(" {} {:.1f}", name, t);
      if (r.stations.empty()) std::printf("%s %d\n", one.c_str(), seed);
      else std::printf("%s\n", line(fmt::format("{} {}", one, seed), single).c_str());
      if (!r.is_planned()) std::printf("    refused by %s: %s %s\n", r.stage.c_str(), r.code.c_str(), r.message.substr(0, 300).c_str());
      std::printf("    s:%s\n", times.c_str());
      std::map<int, std::vector<const study::Station*>> by_edge;
      for (const study::Station& s : r.stations)
        if (s.is_seen) by_edge[s.edge].push_back(&s);
      if (is_verbose)
        for (const auto& [e, v] : by_edge) {
          std::vector<double> a, b, sa, sb, h, t;
          for (const auto* s : v) a.push_back(s->e_1), b.push_back(s->e_2), sa.push_back(s->sd_1), sb.push_back(s->sd_2), h.push_back(s->burr_mm), t.push_back(s->burr_true_mm);
          std::printf("    edge %d: along n_1 %+.3f +- %.3f (claimed %.3f), along n_2 %+.3f +- %.3f (claimed %.3f), burr %.3f (true %.3f)\n", e, mean(a), sd(a), mean(sa), mean(b), sd(b), mean(sb), mean(h), mean(t));
          if (is_dump)
            for (std::size_t k = 0; k < v.size(); k += 3) std::printf("      burr %.3f true %.3f up %.3f sd %.3f width %.3f true %.3f\n", v[k]->burr_mm, v[k]->burr_true_mm, v[k]->burr_upper_mm, v[k]->burr_sd_mm, v[k]->width_mm, v[k]->width_true_mm);
        }
      std::fflush(stdout);
    }
    const double s = std::sqrt(std::pow(sd(sum.burr_true), 2) + std::pow(sd(sum.burr_measured), 2)) / 10;  // of a mean over 100 points
    table.push_back(line(one, sum));
    table.push_back(fmt::format("    planned {}/{} | worst p95 over its floor {:+.3f}, median {:+.3f} mm | burr |z| of means over 100 points {:.2f}; found above limit {:.1f} % of {:.0f}; false alarms {:.2f} % of {:.0f}; upper bound over the truth by {:.2f} (median); width off by {:+.3f} rms {:.3f}, ratio {:.2f} ({:.2f}..{:.2f})",
                                sum.planned, sum.runs, quantile(sum.run_p95_excess, 1), quantile(sum.run_p95_excess, 0.5), std::abs(mean(sum.burr)) / std::max(1e-9, s), 100 * sum.above_found / std::max(1.0, sum.above), sum.above,
                                100 * sum.bare_alarm / std::max(1.0, sum.bare), sum.bare, quantile(sum.upper_over, 0.5), mean(sum.width), rms(sum.width), quantile(sum.width_ratio, 0.5), quantile(sum.width_ratio, 0.05), quantile(sum.width_ratio, 0.95)));
  }
  std::printf("\n");
  for (const std::string& t : table) std::printf("%s\n", t.c_str());
  std::printf("%s\n", line("all", all).c_str());
  return 0;
}
