// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/simulate/sensor.hpp"

#include <cmath>
#include <map>
#include <tuple>

namespace asbuilt::simulate_detail {
namespace {

/// White noise filtered by a Gaussian of s pixels, unit variance.
std::vector<double> correlated_noise(int nx, int ny, double s, Random& random) {
  std::vector<double> a(static_cast<std::size_t>(nx) * ny), b(a.size());
  for (double& v : a) v = random.normal();
  const int r = static_cast<int>(std::ceil(3 * s));
  std::vector<double> k;
  double sum2 = 0;
  for (int i = -r; i <= r; ++i) k.push_back(std::exp(-0.5 * i * i / (s * s))), sum2 += k.back() * k.back();
  for (double& v : k) v /= std::sqrt(sum2);
  for (int pass = 0; pass < 2; ++pass) {
    for (int y = 0; y < ny; ++y)
      for (int x = 0; x < nx; ++x) {
        double v = 0, w2 = 0;
        for (int i = -r; i <= r; ++i) {
          const int xx = pass == 0 ? x + i : x, yy = pass == 0 ? y : y + i;
          if (xx < 0 || yy < 0 || xx >= nx || yy >= ny) continue;
          v += k[i + r] * a[static_cast<std::size_t>(yy) * nx + xx];
          w2 += k[i + r] * k[i + r];
        }
        b[static_cast<std::size_t>(y) * nx + x] = v / std::sqrt(w2);
      }
    a.swap(b);
  }
  return a;
}

}  // namespace

void draw_device(SensorModel& m, Random& random) {
  for (double& f : m.form) f = random.normal();
  m.scale = random.normal(0, 1e-6 * m.scale_ppm);
}

void lose_points(std::vector<Eigen::Vector3f>& points, double share, Random& random) {
  std::map<std::tuple<int, int, int>, bool> lost;
  std::erase_if(points, [&](const Eigen::Vector3f& p) {
    const auto key = std::make_tuple(static_cast<int>(std::floor(p.x() / 5)), static_cast<int>(std::floor(p.y() / 5)), static_cast<int>(std::floor(p.z() / 5)));
    const auto [it, fresh] = lost.try_emplace(key, false);
    if (fresh) it->second = random.uniform() < share;
    return it->second;
  });
}

std::vector<Eigen::Vector3f> scan(const MeshQuery& scene, const SensorSpec& sheet, const SensorModel& model,
                                  const Pose<frame::Base, frame::Sensor>& T_base_sensor, Random& random,
                                  const std::vector<Chip>& chips) {
  const double z0 = sheet.working_distance_mm;
  const int nx = static_cast<int>(sheet.field_of_view_mm[0] / model.pitch_mm), ny = static_cast<int>(sheet.field_of_view_mm[1] / model.pitch_mm);
  const std::vector<double> noise = correlated_noise(nx, ny, model.correlation_px, random);
  const double bend[4] = {random.normal(), random.normal(), random.normal(), random.normal()};
  const Vec3 camera = T_base_sensor.p_mm, projector = T_base_sensor.point(Vec3(model.baseline_mm, 0, 0));

  std::vector<double> range(static_cast<std::size_t>(nx) * ny, -1), slope(range.size(), 1), wild(range.size(), 0);
  std::vector<Vec3> ray(range.size());
  std::vector<Eigen::Vector3f> out;
  for (int y = 0; y < ny; ++y)
    for (int x = 0; x < nx; ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * nx + x;
      const double u = (x + 0.5) / nx - 0.5, v = (y + 0.5) / ny - 0.5;
      ray[i] = Vec3(u * sheet.field_of_view_mm[0], v * sheet.field_of_view_mm[1], z0).normalized();
      const Vec3 d = T_base_sensor.direction(ray[i]);
      auto hit = scene.first_hit(camera, d, 2 * sheet.range_mm[1]);
      const double keep = random.uniform(), mix = random.uniform(), gloss = random.uniform();
      if (!hit) continue;
      bool is_bevel = false;
      Vec3 n_bevel = Vec3::Zero();
      for (const Chip& c : chips) {
        const Vec3 v = hit->p_mm - c.p;
        const double above = c.m.dot(v) + c.depth_mm;
        if (v.norm() > c.half_length_mm + 3 || std::abs(c.t.dot(v)) > c.half_length_mm || above < 0 || c.m.dot(d) > -0.05) continue;
        hit->distance_mm += -above / c.m.dot(d);
        hit->p_mm = camera + hit->distance_mm * d;
        is_bevel = true, n_bevel = c.m;
      }
      const double depth = hit->distance_mm * ray[i].z();
      if (depth < sheet.range_mm[0] || depth > sheet.range_mm[1]) continue;
      Vec3 n = scene.mesh().triangle_normal(hit->triangle);
      if (is_bevel) n = n_bevel;
      if (n.dot(d) > 0) n = -n;
      const Vec3 to_projector = (projector - hit->p_mm).normalized();
      const double cos_camera = -n.dot(d), cos_projector = n.dot(to_projector);
      if (cos_camera < 0.26 || cos_projector < 0.22) continue;
      const double signal = cos_camera * std::max(0.0, cos_projector);
      if (keep > 1 / (1 + std::exp((0.15 - signal) / 0.04))) continue;
      const double reach = (projector - hit->p_mm).norm();
      if (const auto block = scene.first_hit(hit->p_mm + 1e-3 * n, to_projector, reach); block && block->distance_mm > 1e-2) continue;
      const Vec3 half = (to_projector - d).normalized();
      if (half.dot(n) > std::cos(rad_from_deg(4)) && gloss < 0.5) {
        if (gloss < 0.25) continue;
        wild[i] = (gloss < 0.375 ? 1 : -1) * (1 + 4 * mix) * model.noise_mm;
      } else if (gloss < model.specular_ratio) {
        continue;
      }
      slope[i] = std::pow(std::max(0.2, cos_camera), -model.slope_power);
      range[i] = hit->distance_mm;
      // a pixel whose footprint straddles a step may return anything between the two depths
      if (x > 0 && range[i - 1] > 0 && std::abs(range[i - 1] - range[i]) > 8 * model.pitch_mm) {
        if (mix < 0.2) range[i] += (range[i - 1] - range[i]) * random.uniform();
        else if (mix < 0.5) range[i] = -1;
      }
    }
  for (int y = 0; y < ny; ++y)
    for (int x = 0; x < nx; ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * nx + x;
      const double lottery = random.uniform(), far = random.normal();
      if (range[i] <= 0) continue;
      const double u = 2.0 * x / nx - 1, v = 2.0 * y / ny - 1;
      const double grow = (range[i] / z0) * (range[i] / z0);
      const double form = 0.4 * (model.form[0] + bend[0]) * u * u + 0.4 * (model.form[1] + bend[1]) * v * v + 0.4 * (model.form[2] + bend[2]) * u * v +
                          0.3 * (model.form[3] + bend[3]) * u;
      double e = model.noise_mm * grow * slope[i] * noise[i] * (lottery > 1 - model.tail_ratio ? 3 : 1) + 0.7 * model.bias_mm * form + wild[i] + model.scale * range[i];
      if (lottery < model.outlier_ratio) e += far * 120 * model.noise_mm;
      e = std::round((range[i] + e) / model.quantum_mm) * model.quantum_mm - range[i];
      out.push_back((ray[i] * (range[i] + e)).cast<float>());
    }
  return out;
}

}  // namespace asbuilt::simulate_detail
