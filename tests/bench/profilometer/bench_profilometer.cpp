// SPDX-License-Identifier: GPL-3.0-or-later
// The joint solve beside Powell's method on the same function, from the same start, in the same run: published setting (15 poses, 437
// holes). Two functions: plain least squares as the published system minimises, and the one with the robot's error marginalised.
//   bench_profilometer [start ratio, default 0.1] [evaluations of Powell, default 400000]
//   bench_profilometer table [CALIBRATIONS, default 20] [of these with Powell, default 3]   accuracy, time and convergence beside Powell and the bound
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <fmt/format.h>
#include <string>
#include <vector>

#include "tests/bench/profilometer/powell.hpp"
#include "tests/bench/profilometer/published.hpp"

using namespace asbuilt;

namespace {

/// Time of this process on the processor: what others do on the machine does not enter.
double cpu_s() {
  rusage u{};
  getrusage(RUSAGE_SELF, &u);
  return double(u.ru_utime.tv_sec) + 1e-6 * double(u.ru_utime.tv_usec);
}

struct Row {
  const char* name;
  std::vector<double> seconds[2];  // from 10 % and 30 % off
  int count[2] = {0, 0}, converged[2] = {0, 0};
  double across = 0, depth = 0, field = 0, n = 0;  // squares, from 10 % off
};

/// Published setting. Across: perpendicular to the scan direction, a seam measured in seven poses against the reference pose, as the
/// published system states it; depth: the same along the sensor's depth; field: any point in the frame of the flange.
int table(int count, int powell_count) {
  Row rows[] = {{"joint solve (Ceres)"}, {"NLopt PRAXIS, same function"}, {"classical Powell, same function"}, {"classical Powell, plain squares"}};
  double bound_across = 0, bound_depth = 0, bound_field = 0, n = 0;
  for (int k = 0; k < count; ++k) {
    const auto cell = rig::profilometer_cell(1000 + std::uint64_t(k));
    const auto& setting = published_setting::kSettings[0];
    const auto recipe = published_setting::recipe_for(cell, setting);
    const auto passes = rig::passes_of(cell, simulate::published_stands(rad_from_deg(setting.tilt_deg), false, false));
    const auto views = rig::views_of(cell, passes, 1000 + std::uint64_t(k));
    ProfilometerProblem problem = published_setting::problem_of(recipe, cell.plate, views);
    const auto truth = rig::truth_of(cell);
    const auto points = field_points(problem, {});
    const SolveReport best = solve_joint(problem, truth);
    // Cramer and Rao at the truth, without noise
    auto quiet = cell;
    quiet.robot_sd_mm = quiet.robot_sd_rad = quiet.repeat_sd_mm = quiet.repeat_sd_rad = 0, quiet.hole_sd_mm = 1e-9;
    auto exact = rig::views_of(quiet, passes, 1);
    for (auto& v : exact)
      for (auto& h : v.holes) h.sd_target_mm = Vec3(cell.hole_sd_mm, cell.hole_sd_mm, 0.5 * cell.hole_sd_mm);
    HolePlate plate = cell.plate;
    plate.sd_mm = 0;
    const ProfilometerProblem perfect = published_setting::problem_of(recipe, plate, exact);
    const Eigen::MatrixXd C = covariance_of(information_of(perfect, truth), parameter_table(perfect).size);
    const auto real = published_setting::seam_of(cell, truth);
    const Eigen::VectorXd b = (real.J * C * real.J.transpose()).diagonal();
    for (Eigen::Index i = 0; i < b.size(); ++i) (i % 2 ? bound_depth : bound_across) += b[i] / 6;
    for (const Vec2& uv : points) {
      Eigen::Matrix<double, 3, Eigen::Dynamic> J;
      flange_point(truth, uv, &J);
      bound_field += (J * C * J.transpose()).trace() / 3 / double(points.size());
    }
    ++n;
    const auto size = parameter_table(problem).size;
    for (const int which : {0, 1}) {
      Random random = Random::stream(std::uint64_t(k), "start");
      const ProfilometerState start = published_setting::disturbed(truth, which ? 0.3 : 0.1, random);
      const auto take = [&](Row& row, const ProfilometerState& s, double seconds, const ProfilometerState& lowest) {
        row.seconds[which].push_back(seconds), ++row.count[which];
        double worst = 0, field = 0;
        for (const Vec2& uv : points) {
          worst = std::max(worst, (flange_point(s, uv) - flange_point(lowest, uv)).norm());
          field += (flange_point(s, uv) - flange_point(truth, uv)).squaredNorm() / 3 / double(points.size());
        }
        row.converged[which] += worst < 1e-3;
        if (which) return;
        const Eigen::VectorXd e = published_setting::seam_of(cell, s).place - real.place;
        for (Eigen::Index i = 0; i < e.size(); ++i) (i % 2 ? row.depth : row.across) += e[i] * e[i] / 6;
        row.field += field, ++row.n;
      };
      double t = cpu_s();
      const SolveReport ours = solve_joint(problem, start);
      take(rows[0], ours.state, cpu_s() - t, best.state);
      if (k >= powell_count) continue;
      for (const bool with_robot : {true, false}) {
        ProfilometerProblem p = problem;
        p.has_robot_error = with_robot;
        const SolveReport lowest = with_robot ? best : solve_joint(p, truth);
        const ProfilometerMerit merit(p, lowest.state);
        const peer::Function f = [&](const Eigen::VectorXd& x) { return merit(moved(start, x.cwiseProduct(size))); };
        const Eigen::VectorXd zero = Eigen::VectorXd::Zero(size.size());
        if (with_robot) {
          t = cpu_s();
          const peer::Minimum a = peer::praxis(f, zero, 1e-9, 150000);
          take(rows[1], moved(start, a.x.cwiseProduct(size)), cpu_s() - t, lowest.state);
        }
        t = cpu_s();
        const peer::Minimum q = peer::powell(f, zero, 1e-6, 150000);
        take(rows[with_robot ? 2 : 3], moved(start, q.x.cwiseProduct(size)), cpu_s() - t, lowest.state);
      }
    }
  }
  fmt::print("published setting: 15 poses of 10 degrees one way, 437 holes; {} calibrations, {} of them with Powell; rms mm\n", count, powell_count);
  fmt::print("{:<34} {:>20} {:>18} {:>18} {:>22} {:>22} {:>14} {:>14}\n", "", "across the scan", "depth", "field, an axis", "CPU s, 10 % (most)", "CPU s, 30 % (most)", "from 10 %", "from 30 %");
  fmt::print("{:<34} {:>20.4f} {:>18.4f} {:>18.4f}\n", "Cramer-Rao bound", std::sqrt(bound_across / n), std::sqrt(bound_depth / n), std::sqrt(bound_field / n));
  for (Row& r : rows) {
    if (!r.count[0]) continue;
    fmt::print("{:<34} {:>20} {:>18.4f} {:>18.4f}", r.name, fmt::format("{:.4f}", std::sqrt(r.across / r.n)), std::sqrt(r.depth / r.n), std::sqrt(r.field / r.n));
    for (auto& s : r.seconds) {
      std::sort(s.begin(), s.end());
      fmt::print(" {:>22}", fmt::format("{:.3f} ({:.3f})", s[s.size() / 2], s.back()));
    }
    for (const int w : {0, 1}) fmt::print(" {:>14}", fmt::format("{} of {}", r.converged[w], r.count[w]));
    fmt::print("\n");
  }
  fmt::print("from 10 %, 30 %: ends within 0.001 mm of the lowest point of its function, over 49 points of the field\n");
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::string(argv[1]) == "table") return table(argc > 2 ? std::atoi(argv[2]) : 20, argc > 3 ? std::atoi(argv[3]) : 3);
  const double ratio = argc > 1 ? std::atof(argv[1]) : 0.1;
  const long evaluations = argc > 2 ? std::atol(argv[2]) : 400000;
  auto cell = rig::profilometer_cell(1000);
  ProfilometerRecipe recipe = rig::recipe_of(cell);
  recipe.latency = LatencyChoice::known, recipe.latency_s = cell.latency_s, recipe.latency_sd_s = 1e-5;
  const auto views = rig::views_of(cell, rig::passes_of(cell, simulate::published_stands(rad_from_deg(10), false, false)), 1000);
  ProfilometerProblem problem{&recipe, &cell.plate, grouped(views), camera_parameters(rig::sheet())};
  const auto truth = rig::truth_of(cell);
  const auto table = parameter_table(problem);
  // start: every number off by up to `ratio` of its size in the table (lens, plane) or 10 mm and 0.1 rad times 10 ratio
  Random random(7);
  Eigen::VectorXd d(table.size.size());
  for (double& x : d) x = random.uniform(-1, 1) * ratio;
  d[1] = d[2] = d[d.size() - 1] = 0;
  const ProfilometerState start = moved(truth, d.cwiseProduct(table.size));
  std::size_t holes = 0;
  for (const auto& v : views) holes += v.holes.size();
  fmt::print("15 poses, {} holes, start {:.0f} % off; rms: mm per coordinate of the plain residual; field: rms distance of 49 measured points to the truth\n", holes, 100 * ratio);
  fmt::print("{:<44} {:>10} {:>12} {:>16} {:>10} {:>10} {:>8}\n", "", "CPU s", "evaluations", "function", "rms mm", "field mm", "ratio");
  for (const bool with_robot : {false, true}) {
    problem.has_robot_error = with_robot;
    const char* name = with_robot ? "robot's error marginalised" : "plain least squares";
    auto report = [&](const char* solver, double seconds, long count, double value, const ProfilometerState& s, double first) {
      double sum = 0, n = 0, field = 0;
      for (const auto& v : views) {
        const auto p = residuals_of(cell.plate, v, s, false, false);
        sum += p.r.squaredNorm(), n += double(p.r.size());
      }
      const auto points = field_points(problem, {});
      for (const Vec2& uv : points) field += (flange_point(s, uv) - flange_point(truth, uv)).squaredNorm();
      fmt::print("{:<44} {:>10.3f} {:>12} {:>16.6g} {:>10.5f} {:>10.4f} {:>7.0f}x\n", fmt::format("{}, {}", name, solver), seconds, count, value, std::sqrt(sum / n),
                 std::sqrt(field / double(points.size())), seconds / first);
      std::fflush(stdout);
    };
    double t = cpu_s();
    const SolveReport s = solve_joint(problem, start);
    const double ours = cpu_s() - t;
    // one function for all: whitened where Ceres ended
    const ProfilometerMerit merit(problem, s.state);
    report("Ceres", ours, s.iteration_count, merit(s.state), s.state, ours);
    const peer::Function f = [&](const Eigen::VectorXd& x) { return merit(moved(start, x.cwiseProduct(table.size))); };
    const Eigen::VectorXd zero = Eigen::VectorXd::Zero(table.size.size());
    t = cpu_s();
    const peer::Minimum p = peer::praxis(f, zero, 1e-9, int(evaluations));
    report("NLopt PRAXIS", cpu_s() - t, p.evaluation_count, p.value, moved(start, p.x.cwiseProduct(table.size)), ours);
    t = cpu_s();
    const peer::Minimum q = peer::powell(f, zero, 1e-6, evaluations);
    report("classical Powell", cpu_s() - t, q.evaluation_count, q.value, moved(start, q.x.cwiseProduct(table.size)), ours);
  }
  rusage u{};
  getrusage(RUSAGE_SELF, &u);
  fmt::print("peak memory {} MiB\n", u.ru_maxrss / 1024);
}
