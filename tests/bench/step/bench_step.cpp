// SPDX-License-Identifier: GPL-3.0-or-later
// The STEP reader on every file of ../shared/data/step (or $ASBUILT_STEP_DIR): parsing, to B-rep, to a mesh of 1e-3 of the
// diagonal and 0.5 rad. `corpus/...` are all files one after the other; `file/NAME/mesh` each alone.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "planner/io/step/bind.hpp"
#include "planner/io/step/model.hpp"
#include "planner/io/step/p21.hpp"
#include "planner/io/step/step_reader.hpp"
#include "planner/io/step/topology.hpp"

namespace {

using namespace asbuilt;
namespace fs = std::filesystem;

struct Input {
  std::string name, bytes;
  double diagonal_mm = 1;
};

std::vector<Input>& inputs() {
  static std::vector<Input> all = [] {
    std::vector<Input> v;
    const char* dir = std::getenv("ASBUILT_STEP_DIR");
    const fs::path root = dir ? dir : "../shared/data/step";
    if (!fs::exists(root)) return v;
    for (const auto& e : fs::directory_iterator(root)) {
      const std::string x = e.path().extension().string();
      if (x != ".step" && x != ".stp") continue;
      std::ifstream in(e.path(), std::ios::binary);
      v.push_back({e.path().filename().string(), {std::istreambuf_iterator<char>(in), {}}, 1});
      StepOptions o;
      o.want_mesh = false;
      if (const auto r = read_step(v.back().bytes, v.back().name, o)) v.back().diagonal_mm = r->artefact.box.diagonal_mm();
    }
    std::sort(v.begin(), v.end(), [](const Input& a, const Input& b) { return a.name < b.name; });
    return v;
  }();
  return all;
}

std::int64_t total_bytes() {
  std::int64_t n = 0;
  for (const Input& i : inputs()) n += static_cast<std::int64_t>(i.bytes.size());
  return n;
}

StepOptions mesh_options(const Input& i) {
  StepOptions o;
  o.chord_mm = 1e-3 * i.diagonal_mm;
  o.angle_rad = 0.5;
  return o;
}

void parse(benchmark::State& state) {
  for (auto _ : state)
    for (const Input& i : inputs()) {
      p21::File f;
      benchmark::DoNotOptimize(p21::parse(i.bytes, f));
    }
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations()) * total_bytes());
}

/// Parsing, products, units, and every body to faces, loops, edges with exact curves and surfaces.
void parse_and_bind(benchmark::State& state) {
  for (auto _ : state)
    for (const Input& i : inputs()) {
      p21::File f;
      if (p21::parse(i.bytes, f)) continue;
      step::Binder b(f);
      std::vector<Unread> unread;
      const step::Model m = step::read_model(b, unread);
      std::vector<std::int64_t> seen;
      for (const step::BodyUse& u : m.bodies) {
        if (std::find(seen.begin(), seen.end(), u.body) != seen.end()) continue;
        seen.push_back(u.body);
        b.units = u.units;
        benchmark::DoNotOptimize(step::read_body(b, u.body, unread));
      }
    }
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations()) * total_bytes());
}

void brep(benchmark::State& state) {
  StepOptions o;
  o.want_mesh = false;
  for (auto _ : state)
    for (const Input& i : inputs()) benchmark::DoNotOptimize(read_step(i.bytes, i.name, o));
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations()) * total_bytes());
}

void mesh(benchmark::State& state) {
  for (auto _ : state)
    for (const Input& i : inputs()) benchmark::DoNotOptimize(read_step(i.bytes, i.name, mesh_options(i)));
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations()) * total_bytes());
}

void mesh_one(benchmark::State& state, const Input* i) {
  std::size_t triangles = 0;
  for (auto _ : state)
    if (const auto r = read_step(i->bytes, i->name, mesh_options(*i))) triangles = r->artefact.mesh.triangles.size();
  state.counters["triangles"] = static_cast<double>(triangles);
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations() * i->bytes.size()));
}

}  // namespace

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  if (inputs().empty()) return 0;
  benchmark::RegisterBenchmark("corpus/parse", parse)->Unit(benchmark::kMillisecond);
  benchmark::RegisterBenchmark("corpus/parse_and_bind", parse_and_bind)->Unit(benchmark::kMillisecond);
  benchmark::RegisterBenchmark("corpus/brep", brep)->Unit(benchmark::kMillisecond);
  benchmark::RegisterBenchmark("corpus/mesh", mesh)->Unit(benchmark::kMillisecond);
  for (const Input& i : inputs())
    benchmark::RegisterBenchmark(("file/" + i.name + "/mesh").c_str(), mesh_one, &i)->Unit(benchmark::kMillisecond);
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
