// SPDX-License-Identifier: GPL-3.0-or-later
// What an inspection plan promises against what simulated pictures from its views hold.
//   study_inspect batches [FIRST_SEED COUNT [fit]]  ring and bracket (others: name them behind, ring,bracket,casting,freeform) of the virtual cell, through files: simulate, inspect (three languages), simulate
//                                            again from the planned captures; with `fit`: predicted sd beside the fit's own
//   study_inspect cad [COUNT_OF_SEEDS]       two parts of other CAD systems before two URDF arms whose real arm differs
// Prints one line an edge group and a summary; exit 0 when every edge agrees within 5 %.
#include <fmt/format.h>

#include <chrono>
#include <cstdio>
#include <filesystem>

#include "planner/base/archive.hpp"
#include "planner/io/cloud_file.hpp"
#include "planner/pipeline/inspect_item.hpp"
#include "planner/plan/inspect/inspect.hpp"
#include "planner/plan/inspect/program.hpp"
#include "planner/simulate/sensor.hpp"
#include "planner/simulate/simulate.hpp"
#include "planner/simulate/true_robot.hpp"
#include "planner/verify/verify.hpp"
#include "postprocessors/post.hpp"
#include "tests/support/inspect_scene.hpp"

namespace {

using namespace asbuilt;
using namespace asbuilt::test;
using inspecting::EdgeStations;
using inspecting::Station;
namespace fs = std::filesystem;

double seconds_since(const std::chrono::steady_clock::time_point& t) { return std::chrono::duration<double>(std::chrono::steady_clock::now() - t).count(); }

struct Summary {
  int plans = 0, refused = 0, edges = 0, within = 0, verified = 0, views = 0;
  int view_edges = 0, view_within = 0;
  double view_sum_ratio = 0, view_over_ratio = 0;
  /// One view alone: what it promises of an edge beside what its own picture holds.
  void view(double predicted, double simulated) {
    ++view_edges, view_within += std::abs(predicted - simulated) <= 0.05, view_sum_ratio += std::abs(predicted - simulated), view_over_ratio = std::max(view_over_ratio, predicted - simulated);
  }
  double worst_ratio = 0, sum_ratio = 0, plan_s = 0, least_simulated = 1, least_clearance_mm = 1e9;
  void edge(double predicted, double simulated) {
    const double d = std::abs(predicted - simulated);
    ++edges, within += d <= 0.05, worst_ratio = std::max(worst_ratio, d), sum_ratio += d, least_simulated = std::min(least_simulated, simulated);
  }
  int print(const char* name) const {
    std::printf("%s: %d plans (%d of them with edges refused), %d views, verified %d of %d; edges %d, within 5 %%: %d, worst difference %.1f %%, mean %.2f %%, least simulated coverage %.1f %%, "
                "least clearance %.1f mm, planning %.1f s a plan\n",
                name, plans, refused, views, verified, plans, edges, within, 100 * worst_ratio, 100 * sum_ratio / std::max(1, edges), 100 * least_simulated, least_clearance_mm, plan_s / std::max(1, plans));
    std::printf("%s, single views: %d pairs of view and edge, within 5 %%: %d, mean difference %.2f %%, promised and not held at most %.1f %%\n", name, view_edges, view_within, 100 * view_sum_ratio / std::max(1, view_edges), 100 * view_over_ratio);
    return edges > 0 && within == edges && verified == plans ? 0 : 1;
  }
};

Pose<frame::Base, frame::Sensor> pose_of(const Json& j) {
  const auto& q = j.at("quat");
  const auto& p = j.at("xyz");
  return {Eigen::Quaterniond(q[0].get<double>(), q[1].get<double>(), q[2].get<double>(), q[3].get<double>()).normalized(), Vec3(p[0].get<double>(), p[1].get<double>(), p[2].get<double>())};
}
Vec3 vector_of(const Json& j) { return {j[0].get<double>(), j[1].get<double>(), j[2].get<double>()}; }

/// The true edges of a virtual batch, in base, as stations.
std::vector<EdgeStations> true_edges(const Json& truth, double station_mm) {
  std::vector<EdgeStations> out;
  for (const Json& e : truth.at("edges")) {
    EdgeStations es;
    es.id = e.at("id").get<std::string>(), es.feature = e.at("feature").get<std::string>();
    const auto& s = e.at("s");
    const double length = s.back().get<double>();
    const int n = std::max(1, static_cast<int>(std::round(length / station_mm)));
    for (int i = 0; i < n; ++i) {
      const double at = (i + 0.5) * length / n;
      std::size_t k = 1;
      while (k + 1 < s.size() && s[k].get<double>() < at) ++k;
      const double t = std::clamp((at - s[k - 1].get<double>()) / std::max(1e-9, s[k].get<double>() - s[k - 1].get<double>()), 0.0, 1.0);
      Station st;
      const Vec3 a = vector_of(e.at("p")[k - 1]), b = vector_of(e.at("p")[k]);
      st.s_mm = at, st.p = a + t * (b - a), st.tangent = (b - a).normalized();
      st.n = {vector_of(e.at("n_1")[k]), vector_of(e.at("n_2")[k])};
      for (std::size_t f = 0; f < 2; ++f) {  // into the face: across the edge, away from the other face's normal
        Vec3 into = st.n[f].cross(st.tangent).normalized();
        if (into.dot(st.n[1 - f]) > 0) into = -into;
        st.into[f] = into;
      }
      es.stations.push_back(st);
    }
    out.push_back(std::move(es));
  }
  return out;
}

/// The true edge with the nearest middle.
std::size_t nearest_edge(const SeenStations& seen, const Location& location, const EdgeForecast& f) {
  const Vec3 middle = location.T_base_part.point(f.p_part[f.p_part.size() / 2]);
  std::size_t at = 0;
  double least = 1e9;
  for (std::size_t e = 0; e < seen.edges().size(); ++e)
    for (const Station& s : seen.edges()[e].stations)
      if ((s.p - middle).norm() < least) least = (s.p - middle).norm(), at = e;
  return at;
}

int run_batches(std::uint64_t first, int count, bool wants_fit, const std::vector<std::string>& parts) {
  Summary all;
  const fs::path root = fs::temp_directory_path() / "asbuilt_study_inspect";
  for (const std::string& part : parts)
    for (std::uint64_t seed = first; seed < first + static_cast<std::uint64_t>(count); ++seed) {
      fs::remove_all(root);
      Scenario scenario;
      scenario.part = part, scenario.seed = seed;
      const auto batch_file = simulate(scenario, root / "before");
      if (!batch_file) return std::printf("%s\n", batch_file.error()[0].message.c_str()), 1;
      const InputsRecipe inputs{false, "2026-11-22"};
      const auto batch = load_batch(batch_file->artefact, inputs);
      if (!batch) return std::printf("%s\n", batch.error()[0].message.c_str()), 1;
      const std::string item = batch->artefact.items[0].id;
      const auto begin = std::chrono::steady_clock::now();
      const InspectOptions options{{root / "plan", inputs, {Language::krl, Language::inform, Language::beckhoff}, own_code_tag(), ""}, false};
      const InspectRecord r = inspect_item(batch->artefact, item, options);
      const double took = seconds_since(begin);
      write_inspection(root / "plan", r);
      ++all.plans, all.plan_s += took;
      if (r.status != ItemStatus::emitted) {
        ++all.refused;
        for (const Refusal& why : r.reasons) std::printf("%s %llu: %s %s: %s\n", part.c_str(), static_cast<unsigned long long>(seed), why.code.c_str(), why.where.c_str(), why.message.c_str());
        continue;
      }
      all.views += static_cast<int>(r.inspection->views.size());
      bool is_ok = r.programs.size() == 3;
      for (const ReleasedProgram& p : r.programs) is_ok &= p.verdict.is_ok(), all.least_clearance_mm = std::min(all.least_clearance_mm, p.verdict.clearance_min_mm);
      all.verified += is_ok;

      // pictures from the planned views, by the file that the plan wrote
      std::ofstream(root / "plan" / "scenario.yaml") << fmt::format("asbuilt: scenario/1\npart: {}\nseed: {}\ncaptures: {}/scans.yaml\n", part, seed, item);
      const auto again = load_scenario(root / "plan" / "scenario.yaml");
      if (!again) return std::printf("%s %s\n", again.error()[0].where.c_str(), again.error()[0].message.c_str()), 1;
      const auto after = simulate(again->artefact, root / "after");
      if (!after) return std::printf("%s\n", after.error()[0].message.c_str()), 1;
      const Json truth = Json::parse(bytes_of(root / "after/truth/truth.json"));
      SeenStations seen(true_edges(truth, 1.0), 1.0);
      std::size_t points = 0;
      for (const Json& c : truth.at("captures")) {
        const std::string name = c.at("cloud").get<std::string>();
        if (name.rfind("detail", 0) != 0) continue;
        const auto cloud = read_cloud(bytes_of(root / "after/batch" / item / name), name);
        const auto T = pose_of(c.at("base_sensor_true"));
        SeenStations alone(seen.edges(), 1.0);
        for (const Eigen::Vector3f& p : cloud->points) seen.add(T.point(p.cast<double>())), alone.add(T.point(p.cast<double>()));
        points += cloud->points.size();
        for (const ScanView& v : r.inspection->views) {
          if (v.name + ".ply" != name) continue;
          for (const EdgeForecast& f : r.inspection->edges) {
            const auto it = std::find(v.edges.begin(), v.edges.end(), f.id);
            const double predicted = it == v.edges.end() ? 0 : v.edges_ratio[static_cast<std::size_t>(it - v.edges.begin())], simulated = alone.coverage(nearest_edge(seen, *r.location, f), 6);
            if (predicted > 0 || simulated > 0) all.view(predicted, simulated);
          }
        }
      }
      std::map<std::string, std::pair<double, int>> sd_of_fit;
      if (wants_fit) {
        const auto batch_after = load_batch(after->artefact, inputs);
        const ItemRecord fitted = run_item(batch_after->artefact, item, {root / "out", inputs, {}, own_code_tag(), "fit"});
        for (const Refusal& why : fitted.reasons) std::printf("  fit of the planned scans refused: %s %s\n", why.code.c_str(), why.message.c_str());
        if (fitted.features)
          for (const AdaptedEdge& e : fitted.features->edges) {
            auto& [sum, n] = sd_of_fit[e.id];
            for (std::size_t k = 0; k < e.s_mm.size(); ++k) {
              const Vec3 m = -(e.n_1[k] + e.n_2[k]).normalized(), into = e.n_1[k].cross(e.tangent[k]).normalized();
              sum += std::sqrt(std::max(0.0, m.dot(e.covariance[k] * m))) / std::max(1e-3, std::abs(into.dot(m))), ++n;
            }
          }
      }
      double worst = 0;
      for (const EdgeForecast& f : r.inspection->edges) {
        const double simulated = seen.coverage(nearest_edge(seen, *r.location, f), 6);
        all.edge(f.coverage_ratio, simulated);
        worst = std::max(worst, std::abs(f.coverage_ratio - simulated));
        double mean_sd = 0;
        for (const double sd : f.sd_mm) mean_sd += (std::isfinite(sd) ? sd : 0) / static_cast<double>(f.sd_mm.size());
        std::printf("  %-7s %3llu edge %-8s predicted %6.2f %% (working %5.1f, normal %5.1f) simulated %6.2f %%  sd of a leg %.4f mm%s\n", part.c_str(), static_cast<unsigned long long>(seed), f.id.c_str(),
                    100 * f.coverage_ratio, 100 * f.coverage_working_ratio, 100 * f.coverage_normal_ratio, 100 * simulated, mean_sd,
                    sd_of_fit.count(f.id) && sd_of_fit[f.id].second > 0 ? fmt::format(", the fit says {:.4f}", sd_of_fit[f.id].first / sd_of_fit[f.id].second).c_str() : "");
      }
      std::printf("%s %llu: %zu views, %zu points, %zu edges, worst difference %.1f %%, moves %.1f s, clearance %.1f mm, verified in 3 languages: %s, %.1f s\n", part.c_str(),
                  static_cast<unsigned long long>(seed), r.inspection->views.size(), points, r.inspection->edges.size(), 100 * worst, r.inspection->motion.duration_s, r.inspection->motion.clearance_min_mm, is_ok ? "yes" : "NO", took);
      std::fflush(stdout);
    }
  return all.print("virtual batches");
}

Vec6 drawn_twist(const Mat6& covariance, Random& random) {
  const Eigen::LLT<Mat6> l((covariance + 1e-18 * Mat6::Identity()).eval());
  Vec6 z;
  for (int i = 0; i < 6; ++i) z[i] = random.normal();
  return l.matrixL() * z;
}

int run_cad(int seeds) {
  Summary all;
  const fs::path data = "../shared/data";
  for (const char* cad : {"step/zoo_pillow_block.step", "step/nx9_motor_bracket.step"})
    for (const char* arm : {"robots/kuka_kr16_2", "robots/motoman_gp25"}) {
      const auto spec = robot_of_urdf(data / arm);
      const auto brep = read_step(bytes_of(data / cad), cad);
      if (!spec || !brep) return std::printf("%s or %s could not be read\n", arm, cad), 1;
      auto made = cad_scene(*spec, brep->artefact, 6, 12);
      if (!made) return std::printf("%s before %s: no edge looks up, or the arm has no home\n", cad, arm), 1;
      InspectScene& s = *made;
      const auto begin = std::chrono::steady_clock::now();
      auto plan = plan_inspection({}, s.job, s.location);
      std::size_t refused = 0;
      while (!plan) {  // what cannot be seen is refused by name; the rest is planned without it
        std::vector<int> left = s.job.part.features[0].edges;
        const std::size_t before = left.size();
        for (const Refusal& why : plan.error()) {
          std::printf("  %s, %s: %s at %s: %s\n", cad, arm, why.code.c_str(), why.where.c_str(), why.message.c_str());
          std::erase_if(left, [&](int e) { return (why.where + " ").find("edge " + s.job.part.brep.edges[static_cast<std::size_t>(e)].id + " ") != std::string::npos; });
        }
        refused += before - left.size();
        if (left.empty() || left.size() == before) break;
        s.job.part.features[0].edges = left;
        plan = plan_inspection({}, s.job, s.location);
      }
      const double took = seconds_since(begin);
      ++all.plans, all.refused += refused > 0, all.plan_s += took;
      if (!plan) continue;
      const Inspection& p = plan->artefact;
      all.views += static_cast<int>(p.views.size());
      // the program in the dialects, verified as read back
      const auto program = plan_inspection_program({}, s.job, s.location, p);
      bool is_ok = program.has_value();
      s.job.cell.controller.pulses_per_degree = {1435.64, 1435.64, 1365.33, 1137.78, 1137.78, 910.22}, s.job.cell.controller.speed_unit = SpeedUnit::mm_s;
      s.job.cell.controller.orientation = BeckhoffOrientation::cba, s.job.cell.controller.kinematic_id = 45;
      for (const Language l : {Language::krl, Language::inform, Language::beckhoff}) {
        const PostContext context{s.job.cell, "2026-11-22"};
        const Post* post = find_post(l);
        const auto text = is_ok ? post->write(program->artefact, context) : Result<ProgramText>(refuse({}));
        const auto back = text ? post->read(*text, context) : Result<Program>(refuse({}));
        if (!back) {
          is_ok = false;
          if (!text) std::printf("  %s: %s\n", std::string(name_of(l)).c_str(), text.error()[0].message.c_str());
          continue;
        }
        const Verdict v = verify_inspection(s.job, s.location, p, *back);
        for (const Check& c : v.checks)
          if (!c.is_passed) std::printf("  %s %s: %g, limit %g %s at %s\n", std::string(name_of(l)).c_str(), c.name.c_str(), c.measured, c.limit, c.unit.c_str(), c.where.c_str());
        is_ok &= v.is_ok(), all.least_clearance_mm = std::min(all.least_clearance_mm, v.clearance_min_mm);
      }
      all.verified += is_ok;
      double worst = 0;
      for (int seed = 1; seed <= seeds; ++seed) {
        Random random = Random::stream(static_cast<std::uint64_t>(seed), "study inspect");
        const simulate_detail::TrueRobot real(s.job.cell.robot, s.job.cell.tools[0].T_flange_tool, static_cast<std::uint64_t>(seed), 0.42, 0.07, 0.02);
        Location real_place = s.location;
        real_place.T_base_part = s.location.T_base_part.disturbed(drawn_twist(s.location.covariance, random));
        const auto mount = s.job.cell.sensors[0].T_flange_sensor.disturbed(drawn_twist(s.job.cell.sensors[0].covariance, random));
        Mesh scene = transformed(real_place.T_base_part, s.job.part.brep.mesh);
        for (const Obstacle& o : s.job.cell.obstacles) scene = joined(scene, o.mesh_base);
        SeenStations seen(inspecting::stations_of(s.job, real_place, 1.0), 1.0);
        simulate_detail::SensorModel model;
        const SensorSpec& sheet = s.job.cell.sensors[0];
        model.pitch_mm = sheet.field_of_view_mm[0] / (*sheet.pixels_count)[0], model.noise_mm = sheet.noise_mm, model.baseline_mm = sheet.second_ray_mm->x();
        simulate_detail::draw_device(model, random);
        const Mesh tool = joined(s.job.cell.tools[0].mesh_flange, transformed(s.job.cell.tools[0].T_flange_tool, box_mesh(Vec3(-4, -4, -55), Vec3(4, 4, 0))));
        for (const ScanView& v : p.views) {
          const auto T = real.actual(v.q_rad, random);
          const MeshQuery all_of_it(joined(scene, transformed(T, tool)));
          SeenStations alone(seen.edges(), 1.0);
          for (const Eigen::Vector3f& q : simulate_detail::scan(all_of_it, sheet, model, T * mount, random)) {
            const Vec3 at = (T * mount).point(q.cast<double>());
            seen.add(at), alone.add(at);
          }
          for (std::size_t e = 0; e < p.edges.size(); ++e) {
            const auto it = std::find(v.edges.begin(), v.edges.end(), p.edges[e].id);
            const double predicted = it == v.edges.end() ? 0 : v.edges_ratio[static_cast<std::size_t>(it - v.edges.begin())], simulated = alone.coverage(e, 6);
            if (predicted > 0 || simulated > 0) all.view(predicted, simulated);
          }
        }
        for (std::size_t e = 0; e < p.edges.size(); ++e) {
          const double simulated = seen.coverage(e, 6);
          all.edge(p.edges[e].coverage_ratio, simulated);
          worst = std::max(worst, std::abs(p.edges[e].coverage_ratio - simulated));
          if (std::abs(p.edges[e].coverage_ratio - simulated) > 0.05)
            std::printf("  seed %d edge %s (%zu stations): predicted %.1f %%, simulated %.1f %%\n", seed, p.edges[e].id.c_str(), p.edges[e].s_mm.size(), 100 * p.edges[e].coverage_ratio, 100 * simulated);
        }
      }
      std::printf("%s before %s: %zu edges (%zu refused), %zu views, worst difference over %d seeds %.1f %%, moves %.1f s, clearance %.1f mm, verified in 3 languages: %s, %.1f s\n", cad, arm, p.edges.size(), refused,
                  p.views.size(), seeds, 100 * worst, p.motion.duration_s, p.motion.clearance_min_mm, is_ok ? "yes" : "NO", took);
      std::fflush(stdout);
    }
  return all.print("other CAD, URDF arms");
}

std::vector<std::string> words_of(const std::string& text) {
  std::vector<std::string> out{""};
  for (const char c : text)
    if (c == ',') out.emplace_back();
    else out.back() += c;
  return out;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string mode = argc > 1 ? argv[1] : "";
  if (mode == "batches") return run_batches(argc > 2 ? std::stoull(argv[2]) : 201, argc > 3 ? std::stoi(argv[3]) : 5, argc > 4 && std::string(argv[4]) == "fit",
                                              argc > 5 ? words_of(argv[5]) : std::vector<std::string>{"ring", "bracket"});
  if (mode == "cad") return run_cad(argc > 2 ? std::stoi(argv[2]) : 5);
  std::printf("study_inspect batches [FIRST_SEED COUNT [fit|nofit [PART,..]]] | cad [COUNT_OF_SEEDS]\n");
  return 2;
}
