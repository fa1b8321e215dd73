// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/actual/study.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <sstream>

#include "planner/base/archive.hpp"
#include "planner/burr/burr.hpp"
#include "planner/fit/fit.hpp"
#include "planner/fuse/fuse.hpp"
#include "planner/inputs/inputs.hpp"
#include "planner/locate/locate.hpp"
#include "planner/plan/path/path.hpp"
#include "planner/robot/robot.hpp"
#include "planner/simulate/files.hpp"
#include "planner/simulate/true_robot.hpp"

namespace asbuilt::study {
namespace {

namespace fs = std::filesystem;
using namespace simulate_detail;

std::string read_all(const fs::path& file) {
  std::ifstream f(file, std::ios::binary);
  std::stringstream s;
  s << f.rdbuf();
  return s.str();
}
Vec3 vec(const Json& a) { return Vec3(a[0].get<double>(), a[1].get<double>(), a[2].get<double>()); }
template <class A, class B>
Pose<A, B> pose(const Json& j) {
  const Json& q = j["quat"];
  return {Eigen::Quaterniond(q[0].get<double>(), q[1].get<double>(), q[2].get<double>(), q[3].get<double>()).normalized(), vec(j["xyz"])};
}

Truth load_truth(const fs::path& file, const Location& location) {
  const Json t = Json::parse(read_all(file));
  Truth out;
  out.width_mm = t["width_mm"], out.tolerance_mm = t["tolerance_mm"];
  const CellSpec cell = virtual_cell();
  const auto robot = Robot::from(cell.robot);
  const auto tool_true = pose<frame::Flange, frame::Tool>(t["flange_tool_true"]), tool_given = pose<frame::Flange, frame::Tool>(t["flange_tool_given"]);
  const TrueRobot arm = arm_of(cell.robot, cell.tools[0].T_flange_tool, t["robot_seed"].get<std::uint64_t>());
  const SensorSpec& sheet = cell.sensors[1];
  struct Capture {
    std::string feature;
    Pose<frame::Base, frame::Sensor> real, given;
  };
  std::vector<Capture> captures;
  for (const Json& c : t["captures"])
    if (!c["feature"].get<std::string>().empty())
      captures.push_back({c["feature"], pose<frame::Base, frame::Sensor>(c["base_sensor_true"]), pose<frame::Base, frame::Sensor>(c["base_sensor_given"])});
  for (const Json& e : t["edges"]) {
    TruthEdge edge;
    edge.id = e["id"], edge.feature = e["feature"];
    const auto reference = location.T_base_tool_reference.find(edge.feature);
    const Eigen::Quaterniond q_tool = reference != location.T_base_tool_reference.end() ? reference->second.q : quat_from_z(-Vec3::UnitZ(), Vec3::UnitX());
    const std::size_t step = 2;  // every mm
    for (std::size_t k = 0; k < e["p"].size(); k += step) {
      const Vec3 p = vec(e["p"][k]);
      edge.s_mm.push_back(e["s"][k]), edge.burr_mm.push_back(e["burr_height"][k]), edge.width_mm.push_back(e["burr_width"][k]);
      edge.p.push_back(p), edge.n_1.push_back(vec(e["n_1"][k])), edge.n_2.push_back(vec(e["n_2"][k]));
      Pose<frame::Base, frame::Tool> command(q_tool, p);
      for (int round = 0; round < 3; ++round) {
        const auto q = posture(*robot, command * tool_given.inverse());
        if (!q) break;
        command.p_mm += p - (arm.actual(*q) * tool_true).p_mm;
      }
      edge.touch.push_back(command.p_mm);
      Vec3 seen = Vec3::Zero();
      int n = 0;
      // of the captures taken nearest to the working orientation: elsewhere the arm errs otherwise
      const Eigen::Quaterniond q_sensor = q_tool * tool_given.q.conjugate() * sheet.T_flange_sensor.q;
      const auto turned = [&](const Capture& c) { return c.given.q.angularDistance(q_sensor); };
      double least = 1e300;
      for (const Capture& c : captures)
        if (c.feature == edge.feature) least = std::min(least, turned(c));
      for (const Capture& c : captures) {
        if (c.feature != edge.feature || turned(c) > least + rad_from_deg(20)) continue;
        const Vec3 x = c.real.inverse().point(p);
        if (x.z() < sheet.range_mm[0] || x.z() > sheet.range_mm[1]) continue;
        if (std::abs(x.x()) > 0.47 * sheet.field_of_view_mm[0] * x.z() / sheet.working_distance_mm || std::abs(x.y()) > 0.47 * sheet.field_of_view_mm[1] * x.z() / sheet.working_distance_mm) continue;
        seen += c.given.point(x), ++n;
      }
      edge.seen.push_back(n > 0 ? Vec3(seen / n) : p);
    }
    out.edges.push_back(std::move(edge));
  }
  return out;
}

struct Nearest {
  double distance = 1e300, t = 0;
  std::size_t segment = 0;
  Vec3 p = Vec3::Zero();
};
Nearest nearest(const std::vector<Vec3>& line, const Vec3& q) {
  Nearest best;
  for (std::size_t i = 0; i + 1 < line.size(); ++i) {
    const Vec3 d = line[i + 1] - line[i];
    const double t = std::clamp(d.dot(q - line[i]) / std::max(1e-12, d.squaredNorm()), 0.0, 1.0);
    const Vec3 p = line[i] + t * d;
    if (const double l = (q - p).norm(); l < best.distance) best = {l, t, i, p};
  }
  return best;
}

/// Legs that the ideal flat, laid along `given`, leaves on the edge at `touch`.
std::pair<double, double> legs(const Vec3& n_1, const Vec3& n_2, const Vec3& given, const Vec3& touch, double width) {
  const Vec3 m = (n_1 + n_2).normalized();
  const double c = m.dot(n_1), s = std::sqrt(std::max(1e-9, 1 - c * c));
  const double depth = width * s - m.dot(given - touch);
  return {depth / s, depth / std::sqrt(std::max(1e-9, 1 - std::pow(m.dot(n_2), 2)))};
}

void judge(Run& run, const Truth& truth, const Location& location, const Features& features, const Burrs* burrs) {
  const auto& T = location.T_base_part;
  std::vector<std::vector<Vec3>> adapted(features.edges.size()), drawn(features.edges.size());
  for (std::size_t e = 0; e < features.edges.size(); ++e) {
    for (const Vec3& p : features.edges[e].adapted) adapted[e].push_back(T.point(p));
    for (const Vec3& p : features.edges[e].nominal) drawn[e].push_back(T.point(p));
  }
  for (std::size_t te = 0; te < truth.edges.size(); ++te) {
    const TruthEdge& edge = truth.edges[te];
    const auto within = [&](std::pair<double, double> l) {
      return std::abs(l.first - truth.width_mm) <= truth.tolerance_mm && std::abs(l.second - truth.width_mm) <= truth.tolerance_mm;
    };
    for (std::size_t k = 0; k < edge.p.size(); ++k) {
      if (edge.s_mm[k] < 1 || edge.s_mm[k] > edge.s_mm.back() - 1) continue;
      Station s;
      s.edge = static_cast<int>(te);
      Nearest best, best_drawn;
      std::size_t from = 0;
      for (std::size_t e = 0; e < features.edges.size(); ++e) {
        if (features.edges[e].feature != edge.feature) continue;
        if (const Nearest n = nearest(adapted[e], edge.touch[k]); n.distance < best.distance) best = n, from = e;
        if (const Nearest n = nearest(drawn[e], edge.touch[k]); n.distance < best_drawn.distance) best_drawn = n;
      }
      s.is_seen = best.distance < 1.5;
      s.error_mm = best.distance, s.drawn_mm = best_drawn.distance;
      const Vec3 tangent = edge.n_1[k].cross(edge.n_2[k]).normalized();
      Vec3 off = edge.touch[k] - edge.seen[k];
      off -= tangent * tangent.dot(off);
      s.floor_mm = off.norm();
      const auto adapted_legs = legs(edge.n_1[k], edge.n_2[k], best.p, edge.touch[k], truth.width_mm);
      s.leg_1_mm = adapted_legs.first, s.leg_2_mm = adapted_legs.second;
      s.is_within = s.is_seen && within(adapted_legs);
      s.is_within_floor = within(legs(edge.n_1[k], edge.n_2[k], edge.seen[k], edge.touch[k], truth.width_mm));
      s.is_within_drawn = within(legs(edge.n_1[k], edge.n_2[k], best_drawn.p, edge.touch[k], truth.width_mm));
      if (s.is_seen) {
        const AdaptedEdge& a = features.edges[from];
        const std::size_t i = best.t < 0.5 ? best.segment : best.segment + 1;
        const Vec3 d = T.q.conjugate() * (edge.touch[k] - best.p);
        const Vec3 t = a.tangent[i], x = (a.n_1[i] - t * t.dot(a.n_1[i])).normalized(), y = t.cross(x);
        Eigen::Matrix<double, 3, 2> b;
        b << x, y;
        const Eigen::Vector2d u = b.transpose() * d;
        const Eigen::Matrix2d c = b.transpose() * a.covariance[i] * b;
        s.z2 = u.dot(c.ldlt().solve(u));
        const auto along = [&](const Vec3& n) { return n.dot(d) / std::sqrt(std::max(1e-12, n.dot(a.covariance[i] * n))); };
        s.z_m = along((a.n_1[i] + a.n_2[i]).normalized());
        s.e_1 = a.n_1[i].dot(d), s.e_2 = a.n_2[i].dot(d);
        s.sd_1 = std::sqrt(a.n_1[i].dot(a.covariance[i] * a.n_1[i])), s.sd_2 = std::sqrt(a.n_2[i].dot(a.covariance[i] * a.n_2[i]));
        s.z2_1 = std::pow(along(x), 2), s.z2_2 = std::pow(along((a.n_2[i] - t * t.dot(a.n_2[i])).normalized()), 2);
        s.burr_true_mm = edge.burr_mm[k], s.width_true_mm = edge.width_mm[k];
        for (std::size_t j = 0; j < edge.p.size(); ++j) s.is_burr_near |= std::abs(edge.s_mm[j] - edge.s_mm[k]) < 1.5 && edge.burr_mm[j] > 0;
        if (burrs && from < burrs->edges.size()) {
          const EdgeBurr& g = burrs->edges[from];
          s.burr_mm = g.height_mm[i], s.burr_upper_mm = g.height_upper_mm[i], s.burr_sd_mm = g.height_sd_mm[i], s.width_mm = g.width_mm[i], s.detection_mm = g.detection_limit_mm;
        } else {
          s.burr_mm = std::nan("");
        }
      }
      run.stations.push_back(s);
    }
  }
}

}  // namespace

double quantile(std::vector<double> v, double q) {
  if (v.empty()) return std::nan("");
  std::sort(v.begin(), v.end());
  return v[std::min(v.size() - 1, static_cast<std::size_t>(q * static_cast<double>(v.size())))];
}

namespace {
Run run_in(const Scenario& scenario, const Options& options, const fs::path& folder);
}  // namespace

Run run(const Scenario& scenario, const Options& options) {
  const fs::path folder = options.cache / (scenario.part + "-" + std::to_string(scenario.seed) + (scenario.is_light ? "-light" : "") +
                                           (scenario.trap.empty() ? "" : "-" + scenario.trap + "-" + std::to_string(static_cast<int>(1000 * scenario.trap_size))));
  Run out = run_in(scenario, options, folder);
  std::error_code ignored;
  if (!options.is_kept) fs::remove_all(folder, ignored);
  return out;
}

namespace {
Run run_in(const Scenario& scenario, const Options& options, const fs::path& folder) {
  Run out;
  const auto clock = [] { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); };
  const auto timed = [&](const char* name, auto&& body) {
    const double begin = clock();
    auto r = body();
    out.time_s[name] = clock() - begin;
    return r;
  };
  const auto refused = [&](const char* stage, const Refusals& r) {
    out.stage = stage, out.code = r.front().code, out.message = r.front().where + ": " + r.front().message;
    return out;
  };
  Job job;
  MeasuredCloud cloud;
  Location location;
  if (!fs::exists(folder / "located")) {
    std::error_code ignored;
    fs::remove_all(folder, ignored);
    const auto made = timed("simulate", [&] { return simulate(scenario, folder); });
    if (!made) return refused("simulate", made.error());
    const auto batch = load_batch(made->artefact, {});
    if (!batch) return refused("input", batch.error());
    auto loaded = load_job(batch->artefact, batch->artefact.items.front().id, {});
    if (!loaded) return refused("input", loaded.error());
    job = std::move(loaded->artefact);
    auto fused = timed("fuse", [&] { return fuse({}, job); });
    if (!fused) return refused("fuse", fused.error());
    cloud = std::move(fused->artefact);
    auto located = timed("locate", [&] { return locate({}, job, cloud); });
    if (!located) return refused("locate", located.error());
    location = std::move(located->artefact);
    for (auto& c : job.captures) c = {};
    const Job light = job;
    write_text(folder / "job", to_bytes(light)), write_text(folder / "cloud", to_bytes(cloud)), write_text(folder / "located", to_bytes(location));
    fs::remove_all(folder / "batch", ignored);
  }
  job = from_bytes<Job>(read_all(folder / "job"));
  cloud = from_bytes<MeasuredCloud>(read_all(folder / "cloud"));
  location = from_bytes<Location>(read_all(folder / "located"));
  if (options.disturb) options.disturb(location);
  const Truth truth = load_truth(folder / "truth/truth.json", location);
  const auto fitted = timed("fit", [&] { return fit({}, job, cloud, location); });
  if (!fitted) return refused("fit", fitted.error());
  const auto burrs = timed("burr", [&] { return measure_burrs({}, job, cloud, location, fitted->artefact); });
  judge(out, truth, location, fitted->artefact, burrs ? &burrs->artefact : nullptr);
  if (!burrs) return refused("burr", burrs.error());
  const auto path = timed("path", [&] { return plan_path({}, job, location, fitted->artefact, burrs->artefact); });
  if (!path) return refused("path", path.error());
  out.share_ratio = path->artefact.edge_share_ratio;
  return out;
}
}  // namespace

}  // namespace asbuilt::study
