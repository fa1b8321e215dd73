// SPDX-License-Identifier: GPL-3.0-or-later
// A finished run against the truth beside its batch. Reads result.json as anybody would.
#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>

#include "planner/base/archive.hpp"
#include "planner/simulate/files.hpp"
#include "planner/simulate/simulate.hpp"
#include "planner/simulate/true_robot.hpp"

namespace asbuilt {
namespace {

using Polyline = std::vector<Vec3>;

Vec3 vec(const Json& a) { return Vec3(a[0].get<double>(), a[1].get<double>(), a[2].get<double>()); }

Polyline points(const Json& a) {
  Polyline p;
  for (const Json& v : a) p.push_back(vec(v));
  return p;
}

struct Nearest {
  double distance = 1e300, t = 0;
  std::size_t segment = 0;
  Vec3 p = Vec3::Zero();
};
Nearest nearest(const Polyline& line, const Vec3& q) {
  Nearest best;
  for (std::size_t i = 0; i + 1 < line.size(); ++i) {
    const Vec3 d = line[i + 1] - line[i];
    const double t = std::clamp(d.dot(q - line[i]) / std::max(1e-12, d.squaredNorm()), 0.0, 1.0);
    const Vec3 p = line[i] + t * d;
    if ((q - p).norm() < best.distance) best = {(q - p).norm(), t, i, p};
  }
  return best;
}

Eigen::Quaterniond quaternion(const Json& q) {
  return Eigen::Quaterniond(q[0].get<double>(), q[1].get<double>(), q[2].get<double>(), q[3].get<double>()).normalized();
}

/// The commands that bring the real tip to the real points, the tool turned as the plan says.
Polyline touch_points(const Json& truth, const Polyline& p_base, const Eigen::Quaterniond& q_base_tool) {
  using namespace simulate_detail;
  const CellSpec cell = virtual_cell();
  const auto robot = Robot::from(cell.robot);
  must(robot.has_value(), "the virtual robot was refused");
  const auto tool = [&](const char* name) {
    return Pose<frame::Flange, frame::Tool>(quaternion(truth[name]["quat"]), vec(truth[name]["xyz"]));
  };
  const auto tool_true = tool("flange_tool_true"), tool_given = tool("flange_tool_given");
  const TrueRobot arm = arm_of(cell.robot, cell.tools[0].T_flange_tool, truth["robot_seed"].get<std::uint64_t>());
  Polyline out;
  for (const Vec3& want : p_base) {
    Pose<frame::Base, frame::Tool> command(q_base_tool, want);
    for (int round = 0; round < 3; ++round) {
      const auto q = posture(*robot, command * tool_given.inverse());
      if (!q) break;
      command.p_mm += want - (arm.actual(*q) * tool_true).p_mm;
    }
    out.push_back(command.p_mm);
  }
  return out;
}

double percentile(std::vector<double> v, double share) {
  if (v.empty()) return std::nan("");
  std::sort(v.begin(), v.end());
  return v[std::min(v.size() - 1, static_cast<std::size_t>(share * static_cast<double>(v.size())))];
}

Result<Json> load(const std::filesystem::path& file) {
  std::ifstream f(file, std::ios::binary);
  std::stringstream s;
  s << f.rdbuf();
  Json j = Json::parse(s.str(), nullptr, false);
  if (!f || j.is_discarded())
    return refuse({.code = "input.unreadable", .where = file.string(), .message = "found no readable JSON", .stage = "input"});
  return j;
}

}  // namespace

Result<Done<std::map<std::string, double>>> compare_with_truth(const std::filesystem::path& out_item, const std::filesystem::path& truth) {
  const auto result = load(out_item / "result.json");
  if (!result) return refuse_all(result.error());
  const auto known = load(truth / "truth.json");
  if (!known) return refuse_all(known.error());
  std::map<std::string, double> out;
  const Json& r = *result;
  const Json& t = *known;
  try {
    if (!r.contains("edges") || r["edges"].empty() || !r.contains("locate") || !r["locate"].contains("base_part"))
      return Done<std::map<std::string, double>>{out, {}};
    const Json& b = r["locate"]["base_part"];
    const Pose<frame::Base, frame::Part> T(
        quaternion(b["quat"]), vec(b["xyz"]));
    const double width = t["width_mm"], tolerance = t["tolerance_mm"];
    std::vector<double> adapted, drawn, burr;
    std::size_t stations = 0, seen = 0, within = 0, within_drawn = 0, sigma_2 = 0, burr_stations = 0;
    for (const Json& e : t["edges"]) {
      const Json& reference = r["locate"]["tool_reference"];
      const std::string feature = e["feature"];
      const Eigen::Quaterniond q_tool = reference.contains(feature) ? quaternion(reference[feature]["quat"]) : quat_from_z(-Vec3::UnitZ(), Vec3::UnitX());
      const Polyline touch = touch_points(t, points(e["p"]), q_tool), n1 = points(e["n_1"]), n2 = points(e["n_2"]);
      const double length = e["s"].back();
      for (std::size_t k = 0; k < touch.size(); ++k) {
        const double s = e["s"][k];
        if (s < 1 || s > length - 1) continue;  // two chamfers meet at an end
        ++stations;
        Nearest best, best_drawn;
        const Json* from = nullptr;
        for (const Json& g : r["edges"]) {
          if (g["feature"] != e["feature"]) continue;
          Polyline a, d;
          for (const Json& p : g["adapted"]) a.push_back(T.point(vec(p)));
          for (const Json& p : g["nominal"]) d.push_back(T.point(vec(p)));
          if (const Nearest n = nearest(a, touch[k]); n.distance < best.distance) best = n, from = &g;
          if (const Nearest n = nearest(d, touch[k]); n.distance < best_drawn.distance) best_drawn = n;
        }
        if (from == nullptr || best.distance > 1.5) continue;
        ++seen;
        adapted.push_back(best.distance), drawn.push_back(best_drawn.distance);
        // legs of the chamfer a path along the given line leaves on the true edge: the flat moves, the faces stay
        const Vec3 m = (n1[k] + n2[k]).normalized();
        const double c1 = m.dot(n1[k]), c2 = m.dot(n2[k]);
        const auto in_tolerance = [&](const Vec3& given) {
          const double depth = width * std::sqrt(std::max(0.0, 1 - c1 * c1)) - m.dot(given - touch[k]);
          const double leg1 = depth / std::sqrt(std::max(1e-9, 1 - c1 * c1)), leg2 = depth / std::sqrt(std::max(1e-9, 1 - c2 * c2));
          return std::abs(leg1 - width) <= tolerance && std::abs(leg2 - width) <= tolerance;
        };
        within += in_tolerance(best.p), within_drawn += in_tolerance(best_drawn.p);
        const Json& g = *from;
        if (g.contains("sigma") && g["sigma"].is_array() && g["sigma"][best.segment].is_number())
          sigma_2 += best.distance <= 2 * g["sigma"][best.segment].get<double>();
        const Json& h = g["burr"]["height"];
        if (h.is_array() && h[best.segment].is_number()) {
          ++burr_stations;
          burr.push_back(h[best.segment].get<double>() - e["burr_height"][k].get<double>());
        }
      }
    }
    const auto share = [](std::size_t a, std::size_t b) { return b == 0 ? std::nan("") : static_cast<double>(a) / static_cast<double>(b); };
    double rms = 0, mean = 0;
    for (double d : burr) rms += d * d / static_cast<double>(burr.size()), mean += d / static_cast<double>(burr.size());
    out["edge_seen_ratio"] = share(seen, stations);
    out["edge_p95_mm"] = percentile(adapted, 0.95);
    out["edge_max_mm"] = percentile(adapted, 1.0);
    out["edge_nominal_p95_mm"] = percentile(drawn, 0.95);
    out["chamfer_within_ratio"] = share(within, seen);
    out["chamfer_nominal_within_ratio"] = share(within_drawn, seen);
    out["burr_rms_mm"] = burr.empty() ? std::nan("") : std::sqrt(rms);
    out["burr_bias_mm"] = burr.empty() ? std::nan("") : mean;
    out["burr_seen_ratio"] = share(burr_stations, seen);
    out["sigma_2_ratio"] = share(sigma_2, seen);
  } catch (const Json::exception& e) {
    return refuse({.code = "input.unreadable", .where = out_item.string(), .message = std::string("result or truth lacks a field: ") + e.what(), .stage = "input"});
  }
  return Done<std::map<std::string, double>>{out, {}};
}

}  // namespace asbuilt
