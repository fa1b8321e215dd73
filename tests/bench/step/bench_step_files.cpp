// SPDX-License-Identifier: GPL-3.0-or-later
// File by file, the best of several runs on one core: parsing beside a plain Part 21 reader, tessellation beside CGAL's mesh refinement of
// the same flattened faces, to B-rep and to a mesh (1e-3 of the diagonal, 0.5 rad), and the peak memory of a process that does just that.
// `bench_step_files NAME..` takes only files with these in their name.
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <functional>

#include "planner/io/step/bind.hpp"
#include "planner/io/step/model.hpp"
#include "planner/io/step/p21.hpp"
#include "planner/io/step/step_reader.hpp"
#include "planner/io/step/tessellate.hpp"
#include "tests/bench/step/corpus_files.hpp"
#include "tests/bench/step/other_readers.hpp"

namespace fs = std::filesystem;
using namespace asbuilt;

namespace {

double processor_s() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// Best of up to five runs, fewer where they are long.
double best_of(const std::function<void()>& f) {
  double best = 1e300, sum = 0;
  for (int k = 0; k < 5 && sum < 0.3; ++k) {
    const double t0 = processor_s();
    f();
    best = std::min(best, processor_s() - t0), sum += processor_s() - t0;
  }
  return best;
}

/// Peak memory of this program started anew to read one file, or none.
double peak_mb_of(const char* program, const std::string& file, double chord_mm) {
  std::fflush(stdout);
  const pid_t child = fork();
  if (child == 0) {
    execl(program, program, "--one", file.c_str(), std::to_string(chord_mm).c_str(), nullptr);
    _exit(127);
  }
  rusage use{};
  int status = 0;
  wait4(child, &status, 0, &use);
  return static_cast<double>(use.ru_maxrss) / 1024;
}

std::string text_of(const fs::path& p) {
  std::ifstream in(p, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

std::vector<step::Body> bodies_of(const p21::File& f) {
  step::Binder b(f);
  std::vector<Unread> unread;
  const step::Model m = step::read_model(b, unread);
  std::vector<std::int64_t> seen;
  std::vector<step::Body> out;
  for (const step::BodyUse& u : m.bodies) {
    if (std::find(seen.begin(), seen.end(), u.body) != seen.end()) continue;
    seen.push_back(u.body), b.units = u.units;
    out.push_back(step::read_body(b, u.body, unread));
  }
  return out;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 4 && std::string(argv[1]) == "--one") {
    const std::string bytes = text_of(argv[2]);
    StepOptions o;
    o.chord_mm = std::atof(argv[3]), o.angle_rad = 0.5;
    return bytes.empty() || read_step(bytes, argv[2], o) ? 0 : 1;
  }
  const std::vector<fs::path> files = bench::corpus_files();
  if (files.empty()) return 0;
  std::printf("%-42s %7s %8s %8s %6s %8s %8s %8s %8s %6s %8s %8s\n", "file", "MB", "parse", "plain", "times", "bind", "B-rep s", "mesh s",
              "CGAL s", "times", "tri", "peak MB");
  double bytes_sum = 0, parse_sum = 0, plain_sum = 0, bind_sum = 0, brep_sum = 0, all_sum = 0, mesh_sum = 0, cgal_sum = 0, worst = 0,
         worst_mb = 0;
  const double empty_mb = peak_mb_of("/proc/self/exe", "", 1);
  for (const fs::path& p : files) {
    const std::string name = p.filename().string();
    bool wanted = argc < 2;
    for (int k = 1; k < argc; ++k) wanted = wanted || name.find(argv[k]) != std::string::npos;
    if (!wanted) continue;
    const std::string bytes = text_of(p);
    const double mb = 1e-6 * static_cast<double>(bytes.size());
    p21::File parsed;
    const double parse = best_of([&] {
      p21::File f;
      (void)p21::parse(bytes, f);
    });
    const double plain = best_of([&] { (void)bench::plain_part21(bytes); });
    const bool is_file = !p21::parse(bytes, parsed);
    std::vector<step::Body> bodies;
    const double bind = best_of([&] {
      p21::File f;
      if (!p21::parse(bytes, f)) bodies = bodies_of(f);
    });
    StepOptions o;
    o.want_mesh = false;
    double diagonal = 0;
    const double brep = best_of([&] {
      const auto r = read_step(bytes, name, o);
      diagonal = r ? r->artefact.box.diagonal_mm() : 0;
    });
    o.want_mesh = true, o.chord_mm = std::max(1e-3 * diagonal, 1e-6), o.angle_rad = 0.5;
    std::size_t triangles = 0;
    const auto whole = [&] {
      const auto r = read_step(bytes, name, o);
      triangles = r ? r->artefact.mesh.triangles.size() : 0;
    };
    const double all = best_of(whole), peak = std::max(0.0, peak_mb_of("/proc/self/exe", p.string(), o.chord_mm) - empty_mb);
    const step::Tolerance tolerance{o.chord_mm, o.angle_rad};
    double ours = 0, cgal = 0;
    if (is_file && diagonal > 0) {
      std::vector<step::Body> fresh = bodies;
      ours = best_of([&] {
        for (step::Body& b : fresh) (void)step::tessellate(b, tolerance);
      });
      cgal = best_of([&] {
        for (step::Body& b : fresh) (void)bench::refined_by_cgal(b, tolerance);
      });
    }
    std::printf("%-42s %7.2f %8.0f %8.0f %6.1f %8.0f %8.4f %8.4f %8.4f %6.1f %8zu %8.1f\n", name.c_str(), mb, mb / parse, mb / plain,
                plain / parse, mb / bind, brep, all, cgal, ours > 0 ? cgal / ours : 0, triangles, peak);
    std::fflush(stdout);
    bytes_sum += mb, parse_sum += parse, plain_sum += plain, bind_sum += bind, brep_sum += brep, all_sum += all, mesh_sum += ours,
        cgal_sum += cgal;
    worst = std::max(worst, all), worst_mb = std::max(worst_mb, peak);
  }
  std::printf(
      "all: %.1f MB; parsing %.0f MB/s, plain reader %.0f MB/s (%.1f times); parsing and binding %.0f MB/s; to B-rep %.2f s, to a mesh "
      "%.2f s, the slowest "
      "file %.2f s; tessellation %.2f s, CGAL's refinement %.2f s (%.1f times); at most %.0f MB beside the program and its input\n",
      bytes_sum, bytes_sum / parse_sum, bytes_sum / plain_sum, plain_sum / parse_sum, bytes_sum / bind_sum, brep_sum, all_sum, worst,
      mesh_sum, cgal_sum, cgal_sum / mesh_sum, worst_mb);
  return 0;
}
