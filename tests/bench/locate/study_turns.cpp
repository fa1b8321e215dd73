// SPDX-License-Identifier: GPL-3.0-or-later
// A ring with lugs put into its fixture at any angle and tilted by up to 10 deg: is it located every time, and is it refused where it
// cannot be: no lugs on it, or only flat views from above? Right: within 1 deg and 2 mm of the truth.
#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

#include "planner/fuse/fuse.hpp"
#include "planner/locate/locate.hpp"
#include "tests/unit/locate/synthetic.hpp"

using namespace asbuilt;
using namespace asbuilt::synthetic;

namespace {

enum class Kind { located, no_lugs, flat };

Result<Done<Location>> run(Kind kind, int index, double angle_deg, double tilt_max_deg, int seed, Truth& truth, Pose<frame::Base, frame::Part>& nominal) {
  Random random = Random::stream(static_cast<std::uint64_t>(seed + index), "study turns");
  const double tilt = rad_from_deg(tilt_max_deg) * std::sqrt(random.uniform()), towards = random.uniform(-kPi, kPi);
  ScanOptions o;
  o.seed = static_cast<std::uint64_t>(seed + index), o.form_mm = 0.05, o.wide_pixels = 90;
  const Eigen::Quaterniond lean(Eigen::AngleAxisd(tilt, Vec3(std::cos(towards), std::sin(towards), 0)));
  o.play = {lean * quat_from_zyx(rad_from_deg(angle_deg), 0, 0), Vec3(random.uniform(-5, 5), random.uniform(-5, 5), random.uniform(-2, 2))};
  PartSpec part = kind == Kind::no_lugs ? make_ring(0) : make_ring();
  if (kind == Kind::no_lugs)
    add_feature(part, "bore", {"hole-top"});
  else
    add_feature(part, "lug1", {"top-4", "top-5", "top-6"});
  Job job = make_job(std::move(part), true);
  job.fixture.play_rad[0] = job.fixture.play_rad[1] = rad_from_deg(tilt_max_deg);
  std::vector<View> views = usual_views({{kind == Kind::no_lugs ? "bore" : "lug1", o.play.point(Vec3(105, 105, 40))}}, kind != Kind::flat);
  views.resize(4);  // the wide ones
  truth = scan(job, views, o);
  nominal = job.fixture.T_base_fixture * job.fixture.T_fixture_part;
  if (kind == Kind::flat)  // a sensor straight above sees the top and the table, no side
    for (std::size_t k = 0; k < job.captures.size(); ++k) {
      const auto T = truth.T_base_part.inverse() * truth.T_base_sensor_true[k];
      std::erase_if(job.captures[k].points_sensor, [&](const Eigen::Vector3f& p) { return std::abs(T.point(p.cast<double>()).z() - 40) > 2.0; });
    }
  const auto cloud = fuse({}, job);
  if (!cloud) return tl::unexpected<Refusals>(cloud.error());
  return locate({}, job, cloud->artefact);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Rings at every angle, tilted; without lugs; from above only.");
  int first = 0, step = 1, refused_step = 30, seed = 1;
  double tilt_deg = 10;
  app.add_option("--first", first, "deg"), app.add_option("--step", step, "deg between angles"), app.add_option("--seed", seed);
  app.add_option("--refused-step", refused_step, "deg between angles of the cases that are to be refused, 0: none"), app.add_option("--tilt", tilt_deg, "most, deg");
  CLI11_PARSE(app, argc, argv);
  int count = 0, right = 0, wrong = 0;
  double most_deg = 0, most_mm = 0;
  std::map<std::string, int> refused;
  Truth truth;
  Pose<frame::Base, frame::Part> nominal;
  for (int angle = first; angle < 360; angle += step) {
    const auto found = run(Kind::located, angle, angle, tilt_deg, seed, truth, nominal);
    ++count;
    if (!found) {
      ++refused[found.error().front().code];
      std::printf("  %d deg refused %s: %s\n", angle, found.error().front().code.c_str(), found.error().front().message.c_str());
      continue;
    }
    const auto& T = found->artefact.T_base_part;
    const double deg = deg_from_rad(T.q.angularDistance(truth.T_base_part.q)), mm = (T.point(Vec3(0, 0, 20)) - truth.T_base_part.point(Vec3(0, 0, 20))).norm();
    const bool is_right = deg < 1 && mm < 2;
    right += is_right, wrong += !is_right;
    if (is_right) most_deg = std::max(most_deg, deg), most_mm = std::max(most_mm, mm);
    if (!is_right) std::printf("  %d deg WRONG by %.2f deg, %.2f mm\n", angle, deg, mm);
    std::fflush(stdout);
  }
  std::printf("angles %d: right %d, wrong %d; most off %.3f deg, %.2f mm\n", count, right, wrong, most_deg, most_mm);
  for (const auto& [code, n] : refused) std::printf("  refused %s: %d\n", code.c_str(), n);
  int accepted = 0;
  for (const Kind kind : {Kind::no_lugs, Kind::flat}) {
    std::map<std::string, int> codes;
    std::string message;
    int cases = 0;
    for (int angle = 0; refused_step > 0 && angle < 360; angle += refused_step, ++cases) {
      const auto found = run(kind, 1000 + angle, angle, tilt_deg, seed, truth, nominal);
      if (found)
        ++accepted, ++codes["ACCEPTED"];
      else
        ++codes[found.error().front().code], message = found.error().front().message;
    }
    for (const auto& [code, n] : codes) std::printf("%s: %s %d of %d\n", kind == Kind::no_lugs ? "without lugs" : "flat views from above", code.c_str(), n, cases);
    if (!message.empty()) std::printf("  %s\n", message.c_str());
  }
  return wrong + accepted;
}
