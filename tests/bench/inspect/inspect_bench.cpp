// SPDX-License-Identifier: GPL-3.0-or-later
// Is anything in the way between a point and the sensor: the inspection planner's tree beside CGAL's AABB tree (behind MeshQuery), same
// triangles, same rays, same run; time of building, of a query, and memory. And a whole plan.
#include <benchmark/benchmark.h>
#include <malloc.h>

#include "planner/base/random.hpp"
#include "planner/geom/mesh_query.hpp"
#include "planner/geom/ray_tree.hpp"
#include "planner/plan/inspect/inspect.hpp"
#include "tests/support/inspect_scene.hpp"

namespace {

using namespace asbuilt;
using namespace asbuilt::test;

/// The ring that comes with the project, on a table.
const Mesh& scene() {
  static const Mesh m = [] {
    const auto brep = read_step(bytes_of("parts/bearing_ring/ring.step"), "ring.step");
    return joined(brep->artefact.mesh, box_mesh({-400, -400, -100}, {400, 400, -1}));
  }();
  return m;
}

struct Query {
  Vec3 p, d;
  double to;
};
/// From points on the part's faces to a sensor 200 mm above some other place of it.
const std::vector<Query>& queries() {
  static const std::vector<Query> all = [] {
    std::vector<Query> q;
    Random random(7);
    const Mesh& m = scene();
    for (int i = 0; i < 20000; ++i) {
      const auto pick = [&](std::size_t& t) {
        t = random.below(m.triangles.size());
        double a = random.uniform(), b = random.uniform();
        if (a + b > 1) a = 1 - a, b = 1 - b;
        const auto& f = m.triangles[t];
        const Vec3 v0 = m.vertices[static_cast<std::size_t>(f[0])], v1 = m.vertices[static_cast<std::size_t>(f[1])], v2 = m.vertices[static_cast<std::size_t>(f[2])];
        return Vec3(v0 + a * (v1 - v0) + b * (v2 - v0));
      };
      std::size_t t, other;
      const Vec3 p = pick(t), eye = pick(other) + Vec3(random.uniform(-80, 80), random.uniform(-80, 80), random.uniform(150, 250));
      const Vec3 from = p + 0.02 * m.triangle_normal(static_cast<int>(t));
      q.push_back({from, (eye - from).normalized(), (eye - from).norm()});
    }
    return q;
  }();
  return all;
}

double megabytes_in_use() {
  const auto i = mallinfo2();
  return static_cast<double>(i.uordblks + i.hblkhd) / 1048576.0;
}

void rays_tree(benchmark::State& state) {
  const RayTree tree(scene());
  std::size_t k = 0, blocked = 0;
  for (auto _ : state) {
    const Query& q = queries()[k++ % queries().size()];
    blocked += tree.is_blocked(q.p, q.d, 1e-4, q.to);
  }
  benchmark::DoNotOptimize(blocked);
  state.counters["triangles"] = static_cast<double>(scene().triangles.size());
  state.counters["MiB"] = static_cast<double>(tree.memory_bytes()) / 1048576.0;
}
BENCHMARK(rays_tree)->Name("rays/planner");

void rays_cgal(benchmark::State& state) {
  queries();
  const double before = megabytes_in_use();
  const MeshQuery tree(scene());
  const double after = megabytes_in_use();
  std::size_t k = 0, blocked = 0;
  for (auto _ : state) {
    const Query& q = queries()[k++ % queries().size()];
    const auto hit = tree.first_hit(q.p, q.d, q.to);
    blocked += hit && hit->distance_mm > 1e-4;
  }
  benchmark::DoNotOptimize(blocked);
  state.counters["triangles"] = static_cast<double>(scene().triangles.size());
  state.counters["MiB"] = after - before;
}
BENCHMARK(rays_cgal)->Name("rays/cgal_aabb");

void build_tree(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(RayTree(scene()).is_empty());
}
BENCHMARK(build_tree)->Name("build/planner")->Unit(benchmark::kMillisecond);

void build_cgal(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(MeshQuery(scene()).is_empty());
}
BENCHMARK(build_cgal)->Name("build/cgal_aabb")->Unit(benchmark::kMillisecond);

void same_answers(benchmark::State& state) {
  const RayTree a(scene());
  const MeshQuery b(scene());
  double differ = 0;
  for (auto _ : state)
    for (const Query& q : queries()) {
      const auto hit = b.first_hit(q.p, q.d, q.to);
      differ += a.is_blocked(q.p, q.d, 1e-4, q.to) != (hit && hit->distance_mm > 1e-4);
    }
  state.counters["differ"] = differ;
  state.counters["of"] = static_cast<double>(queries().size());
}
BENCHMARK(same_answers)->Name("rays/same_answers")->Iterations(1)->Unit(benchmark::kMillisecond);

void plan_block(benchmark::State& state) {
  const InspectScene s = block_scene();
  std::size_t views = 0;
  for (auto _ : state) {
    const auto plan = plan_inspection({}, s.job, s.location);
    views = plan ? plan->artefact.views.size() : 0;
  }
  state.counters["views"] = static_cast<double>(views);
}
BENCHMARK(plan_block)->Name("plan/block")->Iterations(1)->Unit(benchmark::kMillisecond);

}  // namespace

BENCHMARK_MAIN();
