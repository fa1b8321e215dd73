// SPDX-License-Identifier: GPL-3.0-or-later
// The joint solve beside Powell's method on the same function, from the same start, in the same run: published setting (15 poses, 437
// holes). Two functions: plain least squares as the published system minimises, and the one with the robot's error marginalised.
// bench_profilometer [start ratio, default 0.1] [evaluations of Powell, default 400000]
#include <sys/resource.h>

#include <chrono>
#include <cstdlib>
#include <fmt/format.h>

#include "planner/calibrate/profilometer_observe.hpp"
#include "planner/calibrate/profilometer_start.hpp"
#include "tests/bench/profilometer/powell.hpp"
#include "tests/support/profilometer_rig.hpp"

using namespace asbuilt;

namespace {

/// Time of this process on the processor: what others do on the machine does not enter.
double cpu_s() {
  rusage u{};
  getrusage(RUSAGE_SELF, &u);
  return double(u.ru_utime.tv_sec) + 1e-6 * double(u.ru_utime.tv_usec);
}

}  // namespace

int main(int argc, char** argv) {
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
