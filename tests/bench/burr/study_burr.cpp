// SPDX-License-Identifier: GPL-3.0-or-later
// study_burr [EDGES] [ROOT_MAX_MM] [SMOOTH_MM] [rows]: fins of known height on an 80 mm edge, seen by rays from four places (two see both faces, two only the top),
// each place off by what a robot's is; the heights that come out against the truth. Prints error and band by height, z of means over
// 100 sampled points, how many burrs above the stated detection limit are found, false alarms and the root's thickness.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "planner/burr/burr.hpp"
#include "tests/unit/burr/synthetic_burr.hpp"

using namespace asbuilt;
using namespace asbuilt::synthetic;

namespace {

constexpr double kLength_mm = 80, kStep_mm = 0.25, kPitch_mm = 0.17, kNoise_mm = 0.006, kPlaceSd_mm = 0.03, kEnd = 0.35;

struct TrueFin {
  std::vector<double> length_mm;  // along its lean, every kStep_mm
  double lean_rad = 0.7, root_mm = 0.1;
  double at(double s) const {
    const double x = std::clamp(s / kStep_mm, 0.0, static_cast<double>(length_mm.size() - 1));
    const std::size_t i = std::min(length_mm.size() - 2, static_cast<std::size_t>(x));
    return length_mm[i] + (x - static_cast<double>(i)) * (length_mm[i + 1] - length_mm[i]);
  }
  /// The greatest height over the faces: of the two corners of its blunt end.
  double height(double s) const {
    const double l = at(s), c = std::cos(lean_rad), w = std::sin(lean_rad), half = 0.5 * kEnd * root_mm;
    return l <= 0 ? 0 : std::max(l * c + half * w, l * w + half * c);
  }
};

/// Log-normal with a correlation length of 4 mm, no burr over about a seventh of the edge.
TrueFin draw_fin(Random& random, double root_max_mm, double smooth_mm) {
  TrueFin fin;
  fin.lean_rad = random.uniform(0.2, 1.4), fin.root_mm = random.uniform(0.05, root_max_mm);
  const double mean = random.uniform(0.12, 0.7), from = random.uniform(5, 60), to = from + 11;
  double x = random.normal(), y = x, w = x;
  const double keep = std::exp(-kStep_mm / 4), follow = kStep_mm / smooth_mm, gain = std::sqrt(1 + 0.5 * smooth_mm);  // about what smoothing takes
  for (double s = 0; s <= kLength_mm; s += kStep_mm) {
    x = keep * x + std::sqrt(1 - keep * keep) * random.normal();
    y += follow * (x - y), w += follow * (y - w);
    const double end = std::clamp(std::min(std::abs(s - from), std::abs(s - to)) / 1.5, 0.0, 1.0);
    fin.length_mm.push_back(s > from && s < to ? 0.0 : mean * std::exp(0.35 * gain * w) * end);
  }
  return fin;
}

/// What one ray hits: faces z = 0 (y > 0) and y = 0 (z < 0), and the fin's section where the ray passes the edge. In (out over the side,
/// up, along).
bool cast(const TrueFin& fin, const Vec3& from, const Vec3& ray, Vec3& hit, Vec3& normal) {
  double best = 1e9;
  const auto offer = [&](double t, const Vec3& n) {
    if (t > 0 && t < best && ray.dot(n) < 0) best = t, normal = n;
  };
  if (const double t = -from.z() / ray.z(); ray.z() != 0 && (from + t * ray).x() <= 0 && (from + t * ray).x() > -6) offer(t, Vec3::UnitZ());
  if (const double t = -from.x() / ray.x(); ray.x() != 0 && (from + t * ray).z() <= 0 && (from + t * ray).z() > -6) offer(t, Vec3::UnitX());
  const double t0 = -(from.x() * ray.x() + from.z() * ray.z()) / (ray.x() * ray.x() + ray.z() * ray.z()), s = from.y() + t0 * ray.y();
  const double l = s < 0 || s > kLength_mm ? 0 : fin.at(s);
  if (l > 0) {
    const Vec3 d(std::sin(fin.lean_rad), 0, std::cos(fin.lean_rad)), c(std::cos(fin.lean_rad), 0, -std::sin(fin.lean_rad));
    const double root = 0.5 * fin.root_mm, end = kEnd * root;
    const std::array<Vec3, 4> p{-0.05 * d - root * c, l * d - end * c, l * d + end * c, -0.05 * d + root * c};
    for (std::size_t i = 0; i + 1 < 4; ++i) {
      const Vec3 along = p[i + 1] - p[i];
      Vec3 n(-along.z(), 0, along.x());
      n.normalize();
      if (n.dot(0.5 * (p[i] + p[i + 1]) - 0.4 * l * d) < 0) n = -n;
      const double down = ray.dot(n);
      if (down == 0) continue;
      const double t = (p[i] - Vec3(from.x(), 0, from.z())).dot(n) / Vec3(ray.x(), 0, ray.z()).dot(n);
      const Vec3 q(from.x() + t * ray.x(), 0, from.z() + t * ray.z());
      const double u = (q - p[i]).dot(along) / along.squaredNorm();
      if (u >= 0 && u <= 1) offer(t, n);
    }
  }
  if (best > 1e8) return false;
  hit = from + best * ray;
  return std::abs(ray.dot(normal)) > 0.31;  // flatter surfaces return nothing
}

struct Tally {
  double square = 0, bias = 0;
  int count = 0, inside = 0;
  void add(double error, double sd) { square += error * error, bias += error, ++count, inside += std::abs(error) < 1.96 * sd; }
  void print(const char* name) const {
    if (count > 0)
      std::printf("%-12s %6d stations  rms %.3f  bias %+.4f  in 95 %% band %.1f %%\n", name, count, std::sqrt(square / count), bias / count,
                  100.0 * inside / count);
  }
};

}  // namespace

int main(int argc, char** argv) {
  const int edges = argc > 1 ? std::atoi(argv[1]) : 40;
  const double root_max = argc > 2 ? std::atof(argv[2]) : 0.12;  // at the root; the blunt end is a third of it
  const std::array<const char*, 5> names{"none", "below 0.1", "0.1 to 0.3", "0.3 to 0.6", "above 0.6"};
  const double smooth = argc > 3 ? std::atof(argv[3]) : 1.5;  // below this length the height changes evenly
  const bool is_aligned = argc > 4;
  std::array<Tally, 5> by_height;
  Tally all;
  std::vector<double> z, widths, limits;
  long above = 0, found = 0, bare = 0, alarms = 0, silent = 0, stations = 0;
  for (int e = 0; e < edges; ++e) {
    Random random(4100 + static_cast<std::uint64_t>(e));
    const TrueFin fin = draw_fin(random, root_max, smooth);
    // Rays fall (out over the side, up): -0.5, -0.8 from outside; +0.5, -0.8 from inside, which sees the top alone.
    const std::array<Vec3, 4> looks{Vec3(-0.5, 0.1, -0.8), Vec3(-0.7, -0.1, -0.65), Vec3(0.45, 0.1, -0.85), Vec3(0.6, -0.1, -0.7)};
    std::vector<Scan> scans;
    for (const Vec3& look : looks) {
      Scan scan;
      scan.name = "view " + std::to_string(scans.size());
      scan.noise_mm = kNoise_mm;
      const Vec3 ray = look.normalized(), u = ray.cross(Vec3::UnitY()).normalized(), v = u.cross(ray);
      scan.from = Vec3(-ray.y(), ray.x(), -ray.z());  // part: x along, y into the plate, z up
      // The sensor's rows lie turned against the edge (rows along it are what `rows` asks for).
      const double turn = is_aligned ? 0 : random.uniform(0.1, kPi / 2 - 0.1), phase = random.uniform(0, kPitch_mm), reach = kLength_mm + 12;
      for (double i = -reach + phase; i < reach; i += kPitch_mm)
        for (double j = -reach; j < reach; j += kPitch_mm) {
          const double a = std::cos(turn) * i - std::sin(turn) * j, b = std::sin(turn) * i + std::cos(turn) * j;
          if (std::abs(a) > 6 || b < -6 || b > kLength_mm + 6) continue;
          const Vec3 from = a * u + b * v - 50 * ray;
          Vec3 hit, n;
          if (!cast(fin, from, ray, hit, n) || hit.y() < 0 || hit.y() > kLength_mm) continue;
          if (random.uniform() < 0.0003) hit += 0.3 * random.normal() * ray;
          scan.p_part.emplace_back(hit.y(), -hit.x(), hit.z());
          scan.n_part.emplace_back(n.y(), -n.x(), n.z());
        }
      scans.push_back(std::move(scan));
    }
    Measured m = measure(scans, some_place(), 7100 + static_cast<std::uint64_t>(e));
    Mat6 doubt = Mat6::Zero();
    doubt.diagonal().head<3>().setConstant(kPlaceSd_mm * kPlaceSd_mm);
    for (auto& c : m.cloud.captures) {
      c.spacing_mm = kPitch_mm;
      const Vec3 shift(kPlaceSd_mm * random.normal(), kPlaceSd_mm * random.normal(), kPlaceSd_mm * random.normal());
      for (std::size_t i = c.begin; i < c.end; ++i) m.cloud.p_base[i] += shift;
    }
    m.location.corrections.resize(scans.size()), m.location.correction_covariances.assign(scans.size(), doubt);
    Job job = plate_job({}, {0});
    job.recipes[0].burr_max_height_mm = 3;
    const auto r = measure_burrs({}, job, m.cloud, m.location, plate_features({}));
    if (!r) {
      std::printf("edge %d refused: %s\n", e, r.error()[0].message.c_str());
      continue;
    }
    const EdgeBurr& b = r->artefact.edges[0];
    limits.push_back(b.detection_limit_mm);
    double mean = 0, mean_true = 0, square = 0, square_true = 0;
    int count = 0;
    for (std::size_t i = 4; i + 4 < b.height_mm.size(); ++i) {
      const double s = 0.5 * static_cast<double>(i), truth = fin.height(s), h = b.height_mm[i];
      ++stations;
      if (!std::isfinite(h)) {
        ++silent;
        continue;
      }
      const std::size_t k = truth <= 0.005 ? 0 : truth < 0.1 ? 1 : truth < 0.3 ? 2 : truth < 0.6 ? 3 : 4;
      by_height[k].add(h - truth, b.height_sd_mm[i]), all.add(h - truth, b.height_sd_mm[i]);
      mean += h, square += h * h, mean_true += truth, square_true += truth * truth, ++count;
      if (truth > b.detection_limit_mm) ++above, found += h > 0.5 * b.detection_limit_mm;
      bool is_far = true;  // from any burr
      for (double d = -2; d <= 2; d += 0.5) is_far = is_far && fin.height(s + d) <= 0.005;
      if (is_far) ++bare, alarms += h > b.detection_limit_mm;
      if (truth > 0.2 && b.width_mm[i] > 0) widths.push_back(b.width_mm[i] / fin.root_mm);
    }
    mean /= count, mean_true /= count;
    z.push_back((mean - mean_true) / std::sqrt((square / count - mean * mean) / 325 + (square_true / count - mean_true * mean_true) / 100));
  }
  for (std::size_t k = 0; k < names.size(); ++k) by_height[k].print(names[k]);
  all.print("all");
  double sum = 0, rms = 0;
  int within = 0;
  for (const double x : z) sum += x, rms += x * x, within += std::abs(x) < 0.28;
  const double n = static_cast<double>(std::max<std::size_t>(1, z.size()));
  std::printf("z of the mean, an edge: mean %+.2f  rms %.2f  within 0.28: %d of %zu\n", sum / n, std::sqrt(rms / n), within, z.size());
  const auto middle = [](std::vector<double> v) {
    if (v.empty()) return 0.0;
    std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2), v.end());
    return v[v.size() / 2];
  };
  std::printf("detection limit (median) %.3f mm: found %.2f %% of %ld stations above it; false alarms %.2f %% of %ld bare stations\n", middle(limits),
              100.0 * static_cast<double>(found) / static_cast<double>(std::max(1l, above)), above,
              100.0 * static_cast<double>(alarms) / static_cast<double>(std::max(1l, bare)), bare);
  std::printf("thickness of the root, told to true (median) %.2f; stations told as not seen %ld of %ld\n", middle(widths), silent, stations);
  return 0;
}
