// SPDX-License-Identifier: GPL-3.0-or-later
// Castings against their drawings from 24 views each, anywhere in SO(3), with flash and risers and without, pixels lost; beside PCL's
// FPFH and RANSAC on the same scans. Success: within 10 deg and 10 mm at the part's middle, before any refinement. A view that is
// refused as ambiguous is asked for a second one, 135 deg further round. Parts: the four fixed ones (seed 0) or four drawn by seed.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
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
  int scans = 0, found = 0, accepted = 0, wrong = 0, ambiguous = 0, truth_in_set = 0, unmatched = 0, asked = 0, second_accepted = 0, second_wrong = 0;
  int peer_scans = 0, peer_found = 0;
  void add(const Tally& t) {
    scans += t.scans, found += t.found, accepted += t.accepted, wrong += t.wrong, ambiguous += t.ambiguous, truth_in_set += t.truth_in_set, unmatched += t.unmatched;
    asked += t.asked, second_accepted += t.second_accepted, second_wrong += t.second_wrong, peer_scans += t.peer_scans, peer_found += t.peer_found;
  }
  void print(const std::string& name) const {
    std::printf("%-34s best right %3d/%3d  accepted %3d (wrong %d)  ambiguous %2d (truth in set %d)  no match %d  second view: %d of %d (wrong %d)  FPFH+RANSAC %d/%d\n",
                name.c_str(), found, scans, accepted, wrong, ambiguous, truth_in_set, unmatched, second_accepted, asked, second_wrong, peer_found, peer_scans);
    std::fflush(stdout);
  }
};

double seconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

enum class Answer { right, wrong, ambiguous, no_match };

/// Scans of one part that stands still, each sensor's pose known.
class Trial {
 public:
  Trial(const casting_scans::Part& part, const Job& job, const CadModel& cad, std::uint64_t seed) : part_(part), job_(job), cad_(cad) {
    Random random = Random::stream(seed, "anywhere");
    const Eigen::Quaterniond turn = Eigen::Quaterniond(random.normal(), random.normal(), random.normal(), random.normal()).normalized();
    truth_ = {turn, Vec3(random.uniform(-300, 300), random.uniform(-300, 300), random.uniform(-300, 300))};
  }

  void look(const casting_scans::View& view, const casting_scans::Options& o) {
    const casting_scans::Scan s = casting_scans::scan(part_, view, o);
    const Pose<frame::Base, frame::Sensor> T_base_sensor = truth_ * s.T_sensor_part.inverse();
    CloudCapture capture;
    capture.name = "view", capture.sensor = 0, capture.T_base_sensor = T_base_sensor, capture.noise_mm = o.noise_mm;
    const std::int32_t number = static_cast<std::int32_t>(cloud_.captures.size());
    for (std::size_t i = 0; i < s.p_sensor.size(); ++i) {
      cloud_.p_base.push_back(T_base_sensor.point(s.p_sensor[i])), cloud_.n_base.push_back(T_base_sensor.direction(s.n_sensor[i]).cast<float>());
      cloud_.sigma_mm.push_back(static_cast<float>(o.noise_mm)), cloud_.capture.push_back(static_cast<decltype(cloud_.capture)::value_type>(number));
    }
    capture.end = cloud_.p_base.size();
    cloud_.captures.push_back(capture), sensors_.push_back(T_base_sensor.p_mm);
  }

  Answer search() {
    const double before = seconds();
    const Scene scene = make_scene(job_, cloud_, std::clamp(cad_.size_mm / 70, 1.5, 6.0), 2.0);
    found_ = find_candidates(cad_, scene, job_.fixture, sensors_);
    seconds_ += seconds() - before;
    if (check_match({}, job_, found_)) return Answer::no_match;
    if (check_ambiguity({}, job_, cad_, found_)) return Answer::ambiguous;
    return is_best_right() ? Answer::right : Answer::wrong;
  }

  bool is_right(const Pose<frame::Base, frame::Part>& T) const {
    return T.q.angularDistance(truth_.q) < rad_from_deg(10) && (T.point(cad_.center_part) - truth_.point(cad_.center_part)).norm() < 10;
  }
  bool is_best_right() const { return !found_.empty() && is_right(found_.front().T_base_part); }
  bool is_truth_in_set() const { return std::any_of(found_.begin(), found_.end(), [&](const Candidate& c) { return is_right(c.T_base_part); }); }
  double process_seconds() const { return seconds_; }

  void tell(const char* what, std::uint64_t seed) const {
    if (found_.empty()) return (void)std::printf("  seed %d %s: nothing found\n", static_cast<int>(seed), what);
    const Candidate& best = found_.front();
    std::printf("  seed %d %s: best off by %.1f deg, inliers %.2f, see-through %.3f;", static_cast<int>(seed), what,
                deg_from_rad(best.T_base_part.q.angularDistance(truth_.q)), best.inlier_ratio, best.see_through_ratio);
    const auto right = std::find_if(found_.begin(), found_.end(), [&](const Candidate& c) { return is_right(c.T_base_part); });
    if (right == found_.end())
      std::printf(" truth not among %zu\n", found_.size());
    else
      std::printf(" truth is number %d of %zu, %.1f lower\n", static_cast<int>(right - found_.begin()) + 1, found_.size(), best.log_likelihood - right->log_likelihood);
  }

  bool peer() const {
    peers::Cloud scan, model;
    for (std::size_t i = 0; i < cloud_.p_base.size(); ++i)
      if (cloud_.n_base[i].squaredNorm() > 0.5f) scan.p.push_back(cloud_.p_base[i]), scan.n.push_back(cloud_.n_base[i].cast<double>());
    for (const CadSample& m : cad_.samples) model.p.push_back(m.p_part), model.n.push_back(m.n_part);
    return is_right(peers::fpfh_ransac(scan, model, 5.0, 5000).inverse());
  }

 private:
  const casting_scans::Part& part_;
  const Job& job_;
  const CadModel& cad_;
  Pose<frame::Base, frame::Part> truth_;
  MeasuredCloud cloud_;
  std::vector<Vec3> sensors_;
  std::vector<Candidate> found_;
  double seconds_ = 0;
};

Job job_of(const casting_scans::Part& part) {
  Job job;
  job.item_id = part.name, job.part.id = part.name;
  job.part.brep = brep_from_mesh(part.drawing);
  FeatureSpec feature;
  feature.id = "all", feature.recipe = "r";
  for (std::size_t e = 0; e < job.part.brep.edges.size(); ++e)
    if (job.part.brep.edges[e].kind == EdgeKind::sharp_convex) feature.edges.push_back(static_cast<int>(e));
  job.part.features.push_back(feature);
  job.fixture.play_mm = Vec3::Constant(2000);
  return job;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Castings against their drawings from 24 views each, beside PCL's FPFH and RANSAC.");
  int rounds = 3, seed = 1, peer_every = 8, parts_seed = 0, only_view = -1;
  std::string only;
  app.add_option("--rounds", rounds, "0, 30, 60 % of the pixels lost in turn; every third round without flash and risers");
  app.add_option("--seed", seed, "of views and scans");
  app.add_option("--parts", parts_seed, "0: the four fixed parts, else four drawn by this seed");
  app.add_option("--peer-every", peer_every, "the peer on every n-th scan, 0: never");
  app.add_option("--part", only, "only the part of this name");
  app.add_option("--view", only_view, "only this view, 0..23");
  CLI11_PARSE(app, argc, argv);
  Tally all;
  double search_s = 0, prepare_s = 0;
  int prepared = 0, number = 0;
  const auto parts = parts_seed == 0 ? casting_scans::parts() : casting_scans::drawn_parts(static_cast<std::uint64_t>(parts_seed));
  for (const casting_scans::Part& part : parts) {
    if (!only.empty() && part.name != only) continue;
    const Job job = job_of(part);
    CadModel cad = make_cad_model(job.part, 30.0);
    const double before = seconds();
    prepare_free_search(cad);
    prepare_s += seconds() - before, ++prepared;
    for (int round = 0; round < rounds; ++round) {
      Tally tally;
      casting_scans::Options o;
      o.has_extra = round % 3 != 2, o.lost_ratio = 0.3 * (round % 3);
      const auto views = casting_scans::views(static_cast<std::uint64_t>(seed + round), 500);
      for (std::size_t v = 0; v < views.size(); ++v) {
        if (only_view >= 0 && v != static_cast<std::size_t>(only_view)) continue;
        o.seed = static_cast<std::uint64_t>(1000 * (seed + round)) + v;
        Trial trial(part, job, cad, o.seed);
        trial.look(views[v], o);
        const Answer answer = trial.search();
        const bool is_right = trial.is_best_right();
        ++tally.scans, ++number, tally.found += is_right;
        tally.accepted += answer == Answer::right || answer == Answer::wrong, tally.wrong += answer == Answer::wrong;
        tally.ambiguous += answer == Answer::ambiguous, tally.truth_in_set += answer == Answer::ambiguous && trial.is_truth_in_set();
        tally.unmatched += answer == Answer::no_match;
        if (answer == Answer::wrong) trial.tell("WRONG", o.seed);
        if (answer == Answer::no_match) trial.tell("no match", o.seed);
        if (answer == Answer::ambiguous) trial.tell("ambiguous", o.seed);
        if (peer_every > 0 && number % peer_every == 0) ++tally.peer_scans, tally.peer_found += trial.peer();
        search_s += trial.process_seconds();
        if (answer == Answer::ambiguous || answer == Answer::no_match) {
          trial.look(views[(v + 9) % views.size()], o);  // the same height, 135 deg further
          const Answer second = trial.search();
          ++tally.asked, tally.second_accepted += second == Answer::right, tally.second_wrong += second == Answer::wrong;
          if (second != Answer::right) trial.tell("with a second view", o.seed);
        }
      }
      tally.print(part.name + (o.has_extra ? " flash+riser" : " clean") + " lost " + std::to_string(static_cast<int>(100 * o.lost_ratio)) + " %");
      all.add(tally);
    }
  }
  all.print("all");
  std::printf("process seconds: search %.2f a scan, pseudo-symmetries %.2f a drawing\n", search_s / std::max(1, number), prepare_s / std::max(1, prepared));
  return all.wrong + all.second_wrong;
}
