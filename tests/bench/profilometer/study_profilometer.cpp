// SPDX-License-Identifier: GPL-3.0-or-later
// Studies of the profilometer's calibration on simulated captures with fixed seeds; each prints a table.
//   study_profilometer published [N]     error of the field and of a measured seam beside the Cramer-Rao bound, published and own poses
//   study_profilometer convergence [N]   from starts 10 % and 30 % off
//   study_profilometer coverage [N] [S]  95 % bands against the truth, seeds from S on
//   study_profilometer files DIR         captures of a small plate as files, for the command line (run from the source folder)
//   study_profilometer design [N]       published poses and what pose design adds until a point of the field is known to 0.03 mm
//   study_profilometer faults [N]        faults planted, what is said
#include <fmt/format.h>

#include <Eigen/Dense>
#include <cstdlib>
#include <cstring>
#include <map>

#include "planner/calibrate/profilometer_observe.hpp"
#include "planner/calibrate/profilometer_start.hpp"
#include "tests/bench/profilometer/published.hpp"
#include "tests/support/profilometer_files.hpp"

using namespace asbuilt;
using namespace asbuilt::published_setting;

namespace {

void published(int count) {
  fmt::print("{} calibrations each; robot 0.06 mm + 0.01 deg per pose and axis, hole 0.008 mm; 437 holes. rms error (bound, ratio)\n", count);
  fmt::print("{:<46} {:>24} {:>24} {:>24} {:>24} {:>24} {:>20} {:>8}\n", "", "field x mm", "field y mm", "field z mm", "seam across mm", "seam depth mm", "hand-eye mm / deg", "held-out");
  for (const Setting& s : kSettings) {
    double error[5] = {}, bound[5] = {}, field_n = 0, seam_n = 0, shift = 0, turn = 0, held = 0;
    int refused = 0;
    for (int k = 0; k < count; ++k) {
      const auto c = rig::profilometer_cell(1000 + std::uint64_t(k));
      const auto recipe = recipe_for(c, s);
      const auto passes = all_passes(c, s);
      const auto views = rig::views_of(c, passes, 1000 + std::uint64_t(k));
      const auto r = calibrate_profilometer(recipe, c.plate, views, rig::sheet());
      if (!r) {
        ++refused;
        fmt::print("  {}: {}: {}\n", k, r.error().front().code, r.error().front().message);
        continue;
      }
      // Cramer and Rao: information at the truth, without noise, priors as stated
      auto quiet = c;
      quiet.robot_sd_mm = quiet.robot_sd_rad = quiet.repeat_sd_mm = quiet.repeat_sd_rad = 0, quiet.hole_sd_mm = 1e-9;
      auto exact = rig::views_of(quiet, passes, 1);
      for (auto& v : exact)
        for (auto& h : v.holes) h.sd_target_mm = Vec3(c.hole_sd_mm, c.hole_sd_mm, 0.5 * c.hole_sd_mm);
      HolePlate plate = c.plate;
      plate.sd_mm = 0;  // the simulated plate is exact
      ProfilometerProblem problem = problem_of(recipe, plate, exact);
      const auto truth = rig::truth_of(c);
      const Eigen::MatrixXd C = covariance_of(information_of(problem, truth), parameter_table(problem).size);
      const auto& found = r->artefact.state;
      for (const Vec2& uv : field_points(problem, {})) {
        Eigen::Matrix<double, 3, Eigen::Dynamic> J;
        const Vec3 p = flange_point(truth, uv, &J);
        const Mat3 R = c.T_flange_sensor.rotation();
        const Vec3 e = R.transpose() * (flange_point(found, uv) - p);
        const Mat3 B = R.transpose() * J * C * J.transpose() * R;
        for (int a = 0; a < 3; ++a) error[a] += e[a] * e[a], bound[a] += B(a, a);
        ++field_n;
      }
      const Seam is = seam_of(c, found), real = seam_of(c, truth);
      const Eigen::VectorXd e = is.place - real.place;
      const Eigen::VectorXd b = (real.J * C * real.J.transpose()).diagonal();
      for (Eigen::Index i = 0; i < e.size(); ++i) error[3 + i % 2] += e[i] * e[i], bound[3 + i % 2] += b[i];
      seam_n += 6;
      const Vec6 d = twist_between(c.T_flange_sensor, found.T_flange_sensor);
      shift += d.head<3>().squaredNorm(), turn += d.tail<3>().squaredNorm(), held += r->artefact.held_out_rms_mm.squaredNorm();
    }
    fmt::print("{:<46}", s.name);
    for (int a = 0; a < 5; ++a) {
      const double n = a < 3 ? field_n : seam_n, e = std::sqrt(error[a] / n), b = std::sqrt(bound[a] / n);
      fmt::print(" {:>24}", fmt::format("{:.4f} ({:.4f}, {:.2f})", e, b, e / b));
    }
    const double n = count - refused;
    fmt::print(" {:>20} {:>8.3f}  refused {}\n", fmt::format("{:.3f} / {:.4f}", std::sqrt(shift / n), deg_from_rad(std::sqrt(turn / n))), std::sqrt(held / n), refused);
    std::fflush(stdout);
  }
}

void convergence(int count) {
  fmt::print("published setting, {} starts each: ends within 0.001 mm of the solution from the truth\n", count);
  for (const double ratio : {0.1, 0.3}) {
    int plain = 0, whole = 0, restarts = 0;
    for (int k = 0; k < count; ++k) {
      auto c = rig::profilometer_cell(2000 + std::uint64_t(k));
      c.plate.columns_count = 12, c.plate.rows_count = 10, c.plate.pitch_mm = 8, c.plate.large = {{{5, 4}, {8, 4}, {5, 6}}};
      const auto recipe = recipe_for(c, kSettings[0]);
      const auto views = rig::views_of(c, all_passes(c, kSettings[0]), 2000 + std::uint64_t(k));
      ProfilometerProblem problem = problem_of(recipe, c.plate, views);
      const auto truth = rig::truth_of(c);
      const auto best = solve_joint(problem, truth);
      Random random = Random::stream(std::uint64_t(k), "start");
      const auto start = disturbed(truth, ratio, random);
      auto agrees = [&](const ProfilometerState& s) {
        double worst = 0;
        for (const Vec2& uv : field_points(problem, {})) worst = std::max(worst, (flange_point(s, uv) - flange_point(best.state, uv)).norm());
        return worst < 1e-3;
      };
      const auto alone = solve_joint(problem, start);
      const bool is_same = alone.is_converged && agrees(alone.state);
      plain += is_same;
      if (!is_same) fmt::print("  start {}: {} after {} iterations, half the sum of squares {:.4f}, from the truth {:.4f}\n", k, alone.is_converged ? "settled elsewhere" : "not settled", alone.iteration_count, alone.cost, best.cost);
      const auto r = calibrate_profilometer(recipe, c.plate, views, rig::sheet(), start);
      if (r) {
        // its own robust rounds may weigh holes down: compared with the solution from the truth under the same function
        const auto again = calibrate_profilometer(recipe, c.plate, views, rig::sheet(), truth);
        double worst = 0;
        for (const Vec2& uv : field_points(problem, {})) worst = std::max(worst, (flange_point(r->artefact.state, uv) - flange_point(again->artefact.state, uv)).norm());
        if (!(worst < 1e-3)) fmt::print("  start {}: the whole calibration ends {:.4f} mm from that from the truth\n", k, worst);
        whole += worst < 1e-3, restarts += r->artefact.restart_count;
      } else {
        fmt::print("  {}: {}: {}\n", k, r.error().front().code, r.error().front().message);
      }
    }
    fmt::print("{:.0f} % off: one solve from that start {} of {}; calibrate_profilometer {} of {}, {} random restarts\n", 100 * ratio, plain, count, whole, count, restarts);
  }
}

void coverage(int count, std::uint64_t first) {
  fmt::print("{} calibrations, truth inside the 95 % band (49 points of the field, 3 axes; seam; latency)\n", count);
  for (const int which : {1, 3}) {
    const Setting& s = kSettings[which];
    double in[5] = {}, n[5] = {}, z2[5] = {}, stated[3] = {}, bound[3] = {};
    int refused = 0;
    const int runs = which == 3 ? std::max(1, count / 5) : count;
    for (int k = 0; k < runs; ++k) {
      auto c = rig::profilometer_cell(first + std::uint64_t(k));
      c.plate.columns_count = 12, c.plate.rows_count = 10, c.plate.pitch_mm = 8, c.plate.large = {{{5, 4}, {8, 4}, {5, 6}}}, c.plate.sd_mm = 0;
      const auto recipe = recipe_for(c, s);
      const auto views = rig::views_of(c, all_passes(c, s), first + std::uint64_t(k));
      const auto r = calibrate_profilometer(recipe, c.plate, views, rig::sheet());
      if (!r) {
        ++refused;
        continue;
      }
      const auto& a = r->artefact;
      const auto truth = rig::truth_of(c);
      ProfilometerProblem problem = problem_of(recipe, c.plate, views);
      auto quiet = c;
      quiet.robot_sd_mm = quiet.robot_sd_rad = quiet.repeat_sd_mm = quiet.repeat_sd_rad = 0, quiet.hole_sd_mm = 1e-9;
      auto exact = rig::views_of(quiet, all_passes(c, s), 1);
      for (auto& v : exact)
        for (auto& h : v.holes) h.sd_target_mm = Vec3(c.hole_sd_mm, c.hole_sd_mm, 0.5 * c.hole_sd_mm);
      const ProfilometerProblem perfect = problem_of(recipe, c.plate, exact);
      const Eigen::MatrixXd C = covariance_of(information_of(perfect, truth), parameter_table(perfect).size);
      for (const Vec2& uv : field_points(problem, {})) {
        Eigen::Matrix<double, 3, Eigen::Dynamic> J;
        const Vec3 e = flange_point(a.state, uv, &J) - flange_point(truth, uv);
        const Mat3 R = c.T_flange_sensor.rotation();
        const Vec3 es = R.transpose() * e;
        const Mat3 S = R.transpose() * J * a.covariance * J.transpose() * R;
        Eigen::Matrix<double, 3, Eigen::Dynamic> J0;
        flange_point(truth, uv, &J0);
        const Mat3 B = R.transpose() * J0 * C * J0.transpose() * R;
        for (int i = 0; i < 3; ++i) in[i] += std::abs(es[i]) < 1.96 * std::sqrt(S(i, i)), ++n[i], z2[i] += es[i] * es[i] / S(i, i), stated[i] += S(i, i), bound[i] += B(i, i);
      }
      const Seam is = seam_of(c, a.state), real = seam_of(c, truth);
      const Eigen::VectorXd sd = (is.J * a.covariance * is.J.transpose()).diagonal().cwiseSqrt(), e = is.place - real.place;
      for (Eigen::Index i = 0; i < e.size(); ++i)  // tilted about the seam's own point nothing changes: no error, no sd
        if (sd[i] > 1e-6) in[3] += std::abs(e[i]) < 1.96 * sd[i], ++n[3];
      in[4] += std::abs(a.state.latency_s - c.latency_s) < 1.96 * a.latency_sd_s, ++n[4];
    }
    fmt::print("{:<46} {} runs: x {:.1f} %  y {:.1f} %  z {:.1f} %  seam {:.1f} %  latency {:.1f} %  refused {}\n", s.name, runs, 100 * in[0] / n[0], 100 * in[1] / n[1], 100 * in[2] / n[2],
               100 * in[3] / n[3], 100 * in[4] / n[4], refused);
    fmt::print("{:<46} rms of error / sd as stated: {:.3f} {:.3f} {:.3f}; sd as stated / bound at the truth: {:.3f} {:.3f} {:.3f}\n", "", std::sqrt(z2[0] / n[0]), std::sqrt(z2[1] / n[1]), std::sqrt(z2[2] / n[2]),
               std::sqrt(stated[0] / bound[0]), std::sqrt(stated[1] / bound[1]), std::sqrt(stated[2] / bound[2]));
  }
}

void design(int count) {
  fmt::print("published 15 poses (10 degrees), both ways; poses added by design until the field's median sd (largest axis) is 0.03 mm; {} cells\n", count);
  for (int k = 0; k < count; ++k) {
    auto c = rig::profilometer_cell(11000 + std::uint64_t(k));
    const auto recipe = recipe_for(c, kSettings[1]);
    auto passes = all_passes(c, kSettings[1]);
    const auto views = rig::views_of(c, passes, 11000 + std::uint64_t(k));
    const auto first = calibrate_profilometer(recipe, c.plate, views, rig::sheet());
    if (!first) {
      fmt::print("  {}: {}\n", k, first.error().front().message);
      continue;
    }
    const ProfilometerProblem problem = problem_of(recipe, c.plate, views);
    const auto field = field_points(problem, {});
    const auto& state = first->artefact.state;
    std::vector<double> offsets;
    for (const Vec2& uv : {field[21], field[24], field[27]}) offsets.push_back(plane_point(state.intrinsics, uv).y());
    const auto added = poses_to_add(problem, state, field, pose_candidates(c.plate, offsets), 0.03, 20, 40);
    std::string way = fmt::format("{:.3f}", first->artefact.field.median_sd_mm.maxCoeff());
    int pose = passes.back().pose;
    for (const PoseSuggestion& p : added) {
      way += fmt::format(" {:.3f}", p.field_sd_mm);
      ++pose;
      for (const double sign : {1.0, -1.0}) {
        simulate::ProfilometerPass pass;
        pass.name = p.candidate.name + (sign > 0 ? " forth" : " back"), pass.pose = pose;
        pass.velocity_base_mm_s = sign * 40 * c.T_base_target.direction(p.candidate.way_target), pass.duration_s = 130.0 / 40;
        pass.T_base_flange = {p.T_base_flange.q, p.T_base_flange.p_mm - 0.5 * pass.duration_s * pass.velocity_base_mm_s};
        passes.push_back(pass);
      }
    }
    const auto second = calibrate_profilometer(recipe, c.plate, rig::views_of(c, passes, 12000 + std::uint64_t(k)), rig::sheet());
    const auto truth = rig::truth_of(c);
    const auto rms = [&](const ProfilometerState& s) {
      Vec3 sum = Vec3::Zero();
      for (const Vec2& uv : field) sum += (c.T_flange_sensor.rotation().transpose() * (flange_point(s, uv) - flange_point(truth, uv))).cwiseAbs2() / double(field.size());
      return Vec3(sum.cwiseSqrt());
    };
    const Vec3 before = rms(state), after = second ? rms(second->artefact.state) : Vec3::Constant(std::nan(""));
    fmt::print("  cell {}: foretold sd {} ({} poses added); true error x y z before {:.3f} {:.3f} {:.3f}, after {:.3f} {:.3f} {:.3f} mm, sd as stated {:.3f}; first added: {}\n", k, way, added.size(), before.x(), before.y(), before.z(),
               after.x(), after.y(), after.z(), second ? second->artefact.field.median_sd_mm.maxCoeff() : 0.0, added.empty() ? "" : added.front().candidate.name);
  }
}

void faults(int count) {
  struct Fault {
    const char* name;
    std::function<void(simulate::ProfilometerCell&, Random&)> plant;
    const char* expected;
  };
  auto turn = [](double mm, double deg) {
    return [=](simulate::ProfilometerCell& c, Random& r) {
      Vec3 d(r.normal(), r.normal(), r.normal()), w(r.normal(), r.normal(), r.normal());
      c.moved_from = 20 + 2 * int(r.below(20));
      c.moved_by << mm * d.normalized(), rad_from_deg(deg) * w.normalized();
    };
  };
  const std::vector<Fault> all{
      {"none", [](auto&, Random&) {}, "none"},
      {"sensor moved 0.2 mm between captures", turn(0.2, 0), "calibrate.sensor_moved"},
      {"sensor moved 0.1 deg between captures", turn(0, 0.1), "calibrate.sensor_moved"},
      {"one pose wrong by 1 mm", [](auto& c, Random& r) { c.wrong_pose = 3 + int(r.below(30)), c.wrong_by[int(r.below(3))] = 1; }, "calibrate.pose_left_out"},
      {"one pose wrong by 0.3 deg", [](auto& c, Random& r) { c.wrong_pose = 3 + int(r.below(30)), c.wrong_by[3 + int(r.below(3))] = rad_from_deg(0.3); }, "calibrate.pose_left_out"},
      {"plate 0.3 % larger than its file", [](auto& c, Random&) { c.plate_scale_ratio = 1.003; }, "calibrate.plate_scale"},
      {"file of a plate with another pitch", [](auto& c, Random&) { c.plate_scale_ratio = 15.0 / 8; }, "calibrate.plate_scale"},
      {"trigger 12 ms late", [](auto& c, Random&) { c.latency_s = 0.012; }, "calibrate.latency"}};
  fmt::print("{} runs each, 45 poses, 20 deg, turned, both ways; robot 0.06 mm + 0.01 deg\n", count);
  for (const Fault& f : all) {
    std::map<std::string, int> said;
    int right_place = 0;
    for (int k = 0; k < count; ++k) {
      auto c = rig::profilometer_cell(8000 + std::uint64_t(k));
      c.plate.columns_count = 12, c.plate.rows_count = 10, c.plate.pitch_mm = 8, c.plate.large = {{{5, 4}, {8, 4}, {5, 6}}};
      const auto recipe = rig::recipe_of(c);
      Random r = Random::stream(std::uint64_t(k), f.name);
      if (!std::strcmp(f.expected, "none")) c.latency_s = 0;
      f.plant(c, r);
      const auto result = calibrate_profilometer(recipe, c.plate, rig::views_of(c, all_passes(c, {"", 20, true, true}), 8000 + std::uint64_t(k)), rig::sheet());
      std::string codes;
      if (!result) {
        codes = result.error().front().code;
        if (c.moved_from >= 0) right_place += result.error().front().where == fmt::format("between pose {} and pose {}", c.moved_from / 2, c.moved_from / 2 + 1);
      } else {
        for (const Note& n : result->notes)
          if (n.code != "calibrate.open_direction" && codes.find(n.code) == std::string::npos) codes += (codes.empty() ? "" : " + ") + n.code;
        if (codes.empty()) codes = "none";
        for (const Note& n : result->notes)
          if (n.code == "calibrate.pose_left_out") right_place += n.where == fmt::format("pose {}", c.wrong_pose + 1);
        if (!std::strcmp(f.expected, "calibrate.latency")) right_place += std::abs(result->artefact.state.latency_s - 0.012) < 3 * result->artefact.latency_sd_s;
      }
      ++said[codes];
    }
    fmt::print("{:<40} expected {:<26}", f.name, f.expected);
    for (const auto& [code, n] : said) fmt::print(" {} x{}", code, n);
    if (right_place) fmt::print("  right place or number {}", right_place);
    fmt::print("\n");
  }
}

}  // namespace

int main(int argc, char** argv) {
  const std::string what = argc > 1 ? argv[1] : "";
  const int count = argc > 2 ? std::atoi(argv[2]) : 0;
  if (what == "files" && argc > 2) {
    const auto c = rig::small_cell(21);
    const auto passes = rig::raw_passes(c);
    rig::write_captures(argv[2], c, passes, rig::scans_of(c, passes, 21), rig::PassFiles::csv_with_log);
    auto now = c;
    now.moved_from = 0, now.moved_by << 0.12, 0.16, 0, 0, 0, 0;
    const std::vector<simulate::ProfilometerPass> again(passes.begin(), passes.begin() + 2);
    Random robot = Random::stream(21, "robot"), noise = Random::stream(22, "noise");
    const auto errors = simulate::robot_errors(c, passes, robot);
    for (const bool is_moved : {false, true}) {
      std::vector<ProfileScan> scans;
      for (std::size_t i = 0; i < again.size(); ++i) scans.push_back(simulate::scanned(is_moved ? now : c, again[i], int(i), errors[i], noise));
      rig::write_captures(argv[2], c, again, scans, rig::PassFiles::csv_with_log, is_moved ? "slipped.yaml" : "monday.yaml");
    }
    auto metric = rig::small_cell(23);
    metric.device.is_metric = true, metric.device.noise_px = 0.02, metric.device.scale_z_ratio = 1 / 1.02, metric.device.form_mm = 0.02;
    const auto more = rig::raw_passes(metric);
    rig::write_captures(std::string(argv[2]) + "/mm", metric, more, rig::scans_of(metric, more, 23), rig::PassFiles::ply_with_velocity);
    const auto t = c.T_flange_sensor;
    fmt::print("captures.yaml, monday.yaml (nothing moved), slipped.yaml (0.2 mm), mm/captures.yaml (depths 2 % short); true flange_sensor {}, latency {:.3f} ms\n", rig::pose_yaml(t), 1000 * c.latency_s);
  } else if (what == "published") published(count ? count : 100);
  else if (what == "convergence") convergence(count ? count : 200);
  else if (what == "coverage") coverage(count ? count : 500, argc > 3 ? std::strtoull(argv[3], nullptr, 10) : 5000);
  else if (what == "design") design(count ? count : 5);
  else if (what == "faults") faults(count ? count : 20);
  else {
    fmt::print("study_profilometer published | convergence | coverage | design | faults [count], or files DIR\n");
    return 2;
  }
}
