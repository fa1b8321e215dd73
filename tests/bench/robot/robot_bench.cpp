// SPDX-License-Identifier: GPL-3.0-or-later
// Kinematics, clearance and motion against their peers: an iterative inverse from a near start; FCL's distance; dense sampling
// of FCL's distance along a motion. The peer runs in the same process; the ratio is the counter "ratio".
#include <benchmark/benchmark.h>
#include <fcl/geometry/bvh/BVH_model.h>
#include <fcl/narrowphase/distance.h>

#include <chrono>
#include <cmath>
#include <functional>

#include "planner/base/random.hpp"
#include "planner/plan/motion/motion.hpp"
#include "planner/robot/collision.hpp"
#include "planner/robot/kinematic_chain.hpp"
#include "planner/robot/opw.hpp"
#include "tests/unit/motion/small_cell.hpp"

namespace asbuilt {
namespace {

const RobotSpec& spec() {
  static const RobotSpec s = test::small_cell().job.cell.robot;
  return s;
}
const Robot& robot() {
  static const Robot r = *Robot::from(spec());
  return r;
}
std::vector<JointVector> postures(int n) {
  Random random = Random::stream(1, "bench");
  std::vector<JointVector> out(static_cast<std::size_t>(n));
  for (JointVector& q : out)
    for (int i = 0; i < 6; ++i) q[i] = random.uniform(spec().joints[i].min_rad, spec().joints[i].max_rad);
  return out;
}
double seconds(const std::function<void()>& work) {
  const auto t = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - t).count();
}

/// All branches in closed form against one solution of a damped Newton from 0.3 rad away.
void inverse(benchmark::State& state) {
  const auto q = postures(512);
  std::vector<Pose<frame::Base, frame::Flange>> T;
  for (const auto& v : q) T.push_back(robot().forward(v));
  std::size_t k = 0, solutions = 0;
  for (auto _ : state) solutions += robot().inverse(T[k++ % T.size()]).size();
  const double own = seconds([&] { for (int r = 0; r < 20; ++r) for (const auto& t : T) solutions += robot().inverse(t).size(); }) / (20.0 * T.size());
  const KinematicChain chain = chain_of(std::get<OpwParameters>(spec().kinematics));
  const double peer = seconds([&] {
    for (std::size_t i = 0; i < T.size(); ++i) {
      JointVector start = q[i];
      for (double& a : start) a += 0.15;
      benchmark::DoNotOptimize(newton_inverse(chain, rigid_of(T[i]), start, 60));
    }
  }) / static_cast<double>(T.size());
  state.counters["us"] = own * 1e6, state.counters["peer_us"] = peer * 1e6, state.counters["ratio"] = peer / own;
}
BENCHMARK(inverse);

Mesh ball(double radius, int rings) {
  Mesh m;
  for (int i = 0; i <= rings; ++i)
    for (int k = 0; k < 2 * rings; ++k) {
      const double a = kPi * i / rings, b = kPi * k / rings;
      m.vertices.emplace_back(radius * std::sin(a) * std::cos(b), radius * std::sin(a) * std::sin(b), radius * std::cos(a));
    }
  for (int i = 0; i < rings; ++i)
    for (int k = 0; k < 2 * rings; ++k) {
      const int a = i * 2 * rings + k, b = i * 2 * rings + (k + 1) % (2 * rings), c = a + 2 * rings, d = b + 2 * rings;
      m.triangles.push_back({a, c, b}), m.triangles.push_back({b, c, d});
    }
  return m;
}

/// "Is this pair at least 3 mm apart" with the covering balls first, against FCL's distance every time: a fine part, a tool near it.
void clearance(benchmark::State& state) {
  CollisionScene scene(robot());
  Mesh part = ball(150, 110);  // 48400 triangles
  for (Vec3& v : part.vertices) v += Vec3(1230, 0, 700);
  const int p = scene.add("part", kMountBase, part);
  const int t = scene.add("tool", kMountFlange, ball(75, 22));
  std::vector<JointVector> q;
  Random random = Random::stream(2, "bench clearance");
  while (q.size() < 100) {
    JointVector v = spec().home_rad;
    for (double& a : v) a += random.uniform(-0.5, 0.5);
    if (scene.separation(p, t, v).distance_mm < 350) q.push_back(v);
  }
  std::size_t k = 0;
  for (auto _ : state) benchmark::DoNotOptimize(scene.separation(p, t, q[k++ % q.size()], 3.0));
  const double own = seconds([&] { for (const auto& v : q) benchmark::DoNotOptimize(scene.separation(p, t, v, 3.0)); });
  const double peer = seconds([&] { for (const auto& v : q) benchmark::DoNotOptimize(scene.separation(p, t, v)); });
  state.counters["us"] = own / q.size() * 1e6, state.counters["peer_us"] = peer / q.size() * 1e6, state.counters["ratio"] = peer / own;
}
BENCHMARK(clearance);

/// A proof over a whole motion against sampling FCL's distance every degree (which proves nothing).
void certificate(benchmark::State& state) {
  CollisionScene scene(robot());
  Mesh part = ball(150, 110);
  for (Vec3& v : part.vertices) v += Vec3(1230, 0, 700);
  const int p = scene.add("part", kMountBase, part);
  const int t = scene.add("tool", kMountFlange, ball(75, 22));
  JointVector a = spec().home_rad, b = a;
  a[0] -= 0.4, b[0] += 0.4;
  const std::vector<Watch> watches{{t, p, 3}};
  for (auto _ : state) benchmark::DoNotOptimize(scene.certify(watches, {{a, b}, false}));
  const double own = seconds([&] { for (int i = 0; i < 5; ++i) benchmark::DoNotOptimize(scene.certify(watches, {{a, b}, false})); }) / 5;
  const double peer = seconds([&] {
    for (int i = 0; i <= 46; ++i) {
      JointVector q = a;
      q[0] += 0.8 * i / 46;
      benchmark::DoNotOptimize(scene.separation(p, t, q));
    }
  });
  state.counters["us"] = own * 1e6, state.counters["peer_us"] = peer * 1e6, state.counters["ratio"] = peer / own;
}
BENCHMARK(certificate);

/// Twenty-four passes along the edges of a block, from tool path to certified motion.
void motion_24_passes(benchmark::State& state) {
  auto c = test::small_cell();
  c.path.passes.clear();
  const Vec3 p[4] = {{0, 0, 40}, {100, 0, 40}, {100, 60, 40}, {0, 60, 40}};
  const Vec3 inward[4] = {Vec3::UnitY(), -Vec3::UnitX(), -Vec3::UnitY(), Vec3::UnitX()};
  for (int n = 0; n < 24; ++n) c.path.passes.push_back(test::edge_pass(p[n % 4], p[(n + 1) % 4], inward[n % 4], 0.1 + 0.01 * n));
  for (auto _ : state) benchmark::DoNotOptimize(plan_motion({}, c.job, c.location, c.features, c.burrs, c.path));
}
BENCHMARK(motion_24_passes)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace asbuilt

BENCHMARK_MAIN();
