// SPDX-License-Identifier: GPL-3.0-or-later
// Castings against their drawings from 24 views each, anywhere in SO(3), with and without flash and risers; beside PCL's FPFH and
// RANSAC on the same scans. Success: within 10 deg and 10 mm at the part's middle.
// Usage: study_views [rounds] [first_seed] [peer on every n-th scan, 0: never] [only this part]
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <map>
#include <string>
#include <vector>

#include "planner/base/random.hpp"
#include "planner/geom/mesh_brep.hpp"
#include "planner/locate/gates.hpp"
#include "planner/locate/search.hpp"
#include "tests/bench/locate/pcl_peers.hpp"
#include "tests/support/casting_scans.hpp"

using namespace asbuilt;

namespace {

struct Tally {
  int scans = 0, found = 0, accepted = 0, wrong = 0, flagged = 0, flagged_truth_in_set = 0, unmatched = 0, peer_scans = 0, peer_found = 0;
  void add(const Tally& t) {
    scans += t.scans, found += t.found, accepted += t.accepted, wrong += t.wrong, flagged += t.flagged, flagged_truth_in_set += t.flagged_truth_in_set;
    unmatched += t.unmatched, peer_scans += t.peer_scans, peer_found += t.peer_found;
  }
  void print(const std::string& name) const {
    std::printf("%-28s best right %3d/%3d  accepted %3d, of them wrong %d  ambiguous %d (truth in set %d)  no match %d   FPFH+RANSAC %d/%d\n", name.c_str(), found, scans,
                accepted, wrong, flagged, flagged_truth_in_set, unmatched, peer_found, peer_scans);
    std::fflush(stdout);
  }
};

double seconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

}  // namespace

int main(int argc, char** argv) {
  const int rounds = argc > 1 ? std::atoi(argv[1]) : 2, first_seed = argc > 2 ? std::atoi(argv[2]) : 1, peer_every = argc > 3 ? std::atoi(argv[3]) : 8;
  const std::string only = argc > 4 ? argv[4] : "";
  Tally all;
  double search_s = 0, prepare_s = 0, grid_s = 0;
  int prepared = 0, number = 0;
  for (const casting_scans::Part& part : casting_scans::parts()) {
    if (!only.empty() && part.name != only) continue;
    Job job;
    job.item_id = part.name, job.part.id = part.name;
    job.part.brep = brep_from_mesh(part.drawing);
    FeatureSpec feature;
    feature.id = "all", feature.recipe = "r";
    for (std::size_t e = 0; e < job.part.brep.edges.size(); ++e)
      if (job.part.brep.edges[e].kind == EdgeKind::sharp_convex) feature.edges.push_back(static_cast<int>(e));
    job.part.features.push_back(feature);
    job.fixture.play_mm = Vec3::Constant(2000);
    double t0 = seconds();
    CadModel cad = make_cad_model(job.part, 30.0);
    grid_s += seconds() - t0, t0 = seconds();
    prepare_free_search(cad);
    prepare_s += seconds() - t0, ++prepared;
    std::printf("%s: %zu pseudo-symmetries, overlaps", part.name.c_str(), cad.free_search->motions.size());
    for (std::size_t i = 0; i < std::min<std::size_t>(8, cad.free_search->motions.size()); ++i) std::printf(" %.2f", cad.free_search->motions[i].overlap);
    std::printf("\n");
    for (int round = 0; round < rounds; ++round) {
      Tally tally;
      const bool has_extra = round % 3 != 2;
      const double lost = 0.3 * (round % 3);
      int view_number = 0;
      for (const casting_scans::View& view : casting_scans::views(static_cast<std::uint64_t>(first_seed + round), 500)) {
        casting_scans::Options o;
        o.seed = static_cast<std::uint64_t>(1000 * (first_seed + round) + view_number++), o.has_extra = has_extra, o.lost_ratio = lost;
        const casting_scans::Scan s = casting_scans::scan(part, view, o);
        Random random = Random::stream(o.seed, "anywhere");
        const Eigen::Quaterniond turn = Eigen::Quaterniond(random.normal(), random.normal(), random.normal(), random.normal()).normalized();
        const Pose<frame::Base, frame::Sensor> T_base_sensor(turn, Vec3(random.uniform(-300, 300), random.uniform(-300, 300), random.uniform(-300, 300)));
        MeasuredCloud cloud;
        CloudCapture capture;
        capture.name = "view", capture.sensor = 0, capture.T_base_sensor = T_base_sensor, capture.noise_mm = o.noise_mm, capture.end = s.p_sensor.size();
        cloud.captures.push_back(capture);
        for (std::size_t i = 0; i < s.p_sensor.size(); ++i) {
          cloud.p_base.push_back(T_base_sensor.point(s.p_sensor[i])), cloud.n_base.push_back(T_base_sensor.direction(s.n_sensor[i]).cast<float>());
          cloud.sigma_mm.push_back(static_cast<float>(o.noise_mm)), cloud.capture.push_back(0);
        }
        const Pose<frame::Base, frame::Part> truth = T_base_sensor * s.T_sensor_part;
        const auto is_right = [&](const Pose<frame::Base, frame::Part>& T) {
          return T.q.angularDistance(truth.q) < rad_from_deg(10) && (T.point(cad.center_part) - truth.point(cad.center_part)).norm() < 10;
        };
        t0 = seconds();
        const Scene scene = make_scene(job, cloud, std::clamp(cad.size_mm / 70, 1.5, 6.0), 2.0);
        const std::vector<Candidate> found = find_candidates(cad, scene, job.fixture, {T_base_sensor.p_mm});
        search_s += seconds() - t0;
        ++tally.scans, ++number;
        const bool is_found = !found.empty() && is_right(found.front().T_base_part);
        tally.found += is_found;
        if (const auto refusal = check_match({}, job, found)) {
          ++tally.unmatched;
          std::printf("  seed %d no match: %s\n", static_cast<int>(o.seed), refusal->message.c_str());
        } else if (const auto ambiguous = check_ambiguity({}, job, cad, found)) {
          ++tally.flagged;
          tally.flagged_truth_in_set += std::any_of(found.begin(), found.end(), [&](const Candidate& c) { return is_right(c.T_base_part); });
        } else {
          ++tally.accepted, tally.wrong += !is_found;
          if (!is_found)
            std::printf("  seed %d WRONG: off by %.1f deg, inliers %.2f, see-through %.3f\n", static_cast<int>(o.seed),
                        deg_from_rad(found.front().T_base_part.q.angularDistance(truth.q)), found.front().inlier_ratio, found.front().see_through_ratio);
        }
        if (peer_every > 0 && number % peer_every == 0) {
          peers::Cloud scan, model;
          for (std::size_t i = 0; i < s.p_sensor.size(); ++i)
            if (s.n_sensor[i].squaredNorm() > 0.5) scan.p.push_back(cloud.p_base[i]), scan.n.push_back(cloud.n_base[i].cast<double>());
          for (const CadSample& m : cad.samples) model.p.push_back(m.p_part), model.n.push_back(m.n_part);
          ++tally.peer_scans, tally.peer_found += is_right(peers::fpfh_ransac(scan, model, 5.0, 5000).inverse());
        }
      }
      tally.print(part.name + (has_extra ? " flash+riser" : " clean") + " lost " + std::to_string(static_cast<int>(100 * lost)) + " %");
      all.add(tally);
    }
  }
  all.print("all");
  std::printf("process seconds: search %.2f a scan, pseudo-symmetries %.2f a drawing, grid %.2f a drawing\n", search_s / std::max(1, number), prepare_s / std::max(1, prepared),
              grid_s / std::max(1, prepared));
  return all.wrong;
}
