// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/fit/fit.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "planner/base/number.hpp"
#include "planner/fit/checks.hpp"

namespace asbuilt {

namespace fitting {

constexpr double kFarReach_mm = 45;  // into a face of which little was seen beside its edge
namespace {

/// The edges that the finest sensors alone do not settle: there the others count too.
std::vector<char> find_coarse_edges(const Setup& setup, const std::vector<Cell>& fine_cells) {
  std::vector<std::pair<int, int>> seen(setup.edges.size(), {0, 0});
  for (const Cell& c : fine_cells) (c.slot == setup.edges[c.edge].slot_1 ? seen[c.edge].first : seen[c.edge].second)++;
  std::vector<char> out;
  for (const auto& s : seen) out.push_back(s.first < 4 || s.second < 4 ? 1 : 0);
  return out;
}

/// Faces of which an edge has too little beside it. A face seen farther in is as good a plane or cylinder; but an edge that
/// lacks both its faces was not scanned, and stays as it is.
std::vector<char> choose_far(const Setup& setup, const std::vector<Cell>& cells) {
  constexpr int kBesideMin = 250;
  std::vector<std::array<int, 2>> points(setup.edges.size(), {0, 0});
  for (const Cell& c : cells) points[c.edge][c.slot == setup.edges[c.edge].slot_1 ? 0 : 1] += c.points_count;
  std::vector<char> far(setup.faces.size(), 0);
  bool is_any = false;
  for (std::size_t e = 0; e < setup.edges.size(); ++e)
    for (const int side : {0, 1})
      if (points[e][side] < kBesideMin && points[e][1 - side] >= kBesideMin)
        far[side == 0 ? setup.edges[e].slot_1 : setup.edges[e].slot_2] = 1, is_any = true;
  if (!is_any) far.clear();
  return far;
}

std::vector<Pose<frame::Base, frame::Base>> corrections_of(const Setup& setup) {
  std::vector<Pose<frame::Base, frame::Base>> out;
  for (const CaptureModel& c : setup.captures) out.push_back(c.correction);
  return out;
}

/// Shift of the ends of an open edge: to the corner with a third face, where that is one of the fitted faces or the drawing's.
EndShift find_ends(const EdgeModel& edge, const std::vector<FaceModel>& faces, const Brep& brep, double reach_mm) {
  EndShift out;
  if (edge.is_closed) return out;
  for (const bool is_start : {true, false}) {
    const Vec3 vertex = is_start ? edge.nominal.front() : edge.nominal.back();
    const Vec3 tangent = is_start ? edge.tangent.front() : edge.tangent.back();
    double best = reach_mm;
    bool found = false;
    for (std::size_t i = 0; i < brep.edges.size(); ++i) {
      const BrepEdge& other = brep.edges[i];
      if (static_cast<int>(i) == edge.edge || other.p.size() < 2 || other.is_seam) continue;
      if (std::min((other.p.front() - vertex).norm(), (other.p.back() - vertex).norm()) > 0.05) continue;
      for (const int f : {other.face_1, other.face_2}) {
        if (f < 0 || f == faces[edge.slot_1].face || f == faces[edge.slot_2].face) continue;
        FaceModel third;
        const auto fitted = std::find_if(faces.begin(), faces.end(), [&](const FaceModel& m) { return m.face == f; });
        if (fitted != faces.end())
          third = *fitted;
        else
          third.nominal = third.surface = brep.faces[f].surface;
        const auto corner = corner_at(faces[edge.slot_1], faces[edge.slot_2], third, vertex);
        if (!corner) continue;
        const double shift = tangent.dot(*corner - vertex);
        if (!found || std::abs(shift) < std::abs(best)) best = shift, found = true;
      }
    }
    if (found && std::abs(best) < reach_mm) (is_start ? out.start_mm : out.end_mm) = best;
  }
  return out;
}

std::vector<Traced> trace_all(Setup& setup, const Job& job, const FitRecipe& recipe, bool with_ends) {
  std::vector<Traced> out;
  for (const EdgeModel& e : setup.edges)
    out.push_back(trace_edge(e, setup.faces, with_ends ? find_ends(e, setup.faces, job.part.brep, recipe.deviation_max_mm) : EndShift{},
                             recipe.station_mm));
  return out;
}

void choose_fields(Setup& setup, const std::vector<Cell>& cells, const Bundle& bundle, const Pose<frame::Base, frame::Part>& T_base_part) {
  const auto T_part_base = T_base_part.inverse();
  for (std::size_t f = 0; f < setup.faces.size(); ++f) {
    FaceModel& face = setup.faces[f];
    std::vector<Vec3> feet;
    std::vector<std::size_t> index;
    for (std::size_t i = 0; i < cells.size(); ++i) {
      if (cells[i].slot != static_cast<int>(f)) continue;
      const Vec3 p = T_part_base.point(setup.captures[cells[i].capture].correction.point(cells[i].p_base));
      Vec3 n;
      const double d = surface_distance(face, p, n);
      feet.push_back(p - d * n);
      index.push_back(i);
    }
    // A cell that stands alone against its neighbours is no form: it would ask for a short and tall field.
    const auto stands_alone = [&](std::size_t k) {
      std::vector<std::pair<double, double>> near;  // squared distance, residual
      for (std::size_t j = 0; j < feet.size(); ++j)
        if (j != k) near.emplace_back((feet[j] - feet[k]).squaredNorm(), bundle.residual_mm[index[j]]);
      constexpr std::size_t kNeighbours = 7;
      if (near.size() < kNeighbours) return false;
      std::nth_element(near.begin(), near.begin() + kNeighbours - 1, near.end());
      std::array<double, kNeighbours> beside;
      for (std::size_t j = 0; j < kNeighbours; ++j) beside[j] = near[j].second;
      std::nth_element(beside.begin(), beside.begin() + kNeighbours / 2, beside.end());
      return std::abs(bundle.residual_mm[index[k]] - beside[kNeighbours / 2]) > 0.02 + 4 * cells[index[k]].sd_mm;
    };
    constexpr std::size_t kCellsMax = 120;
    std::vector<std::size_t> kept;
    for (std::size_t k = 0; k < std::min(kCellsMax, feet.size()); ++k)
      if (const std::size_t i = k * feet.size() / std::min(kCellsMax, feet.size()); !stands_alone(i)) kept.push_back(i);
    const std::size_t count = kept.size();
    std::vector<Vec3> q;
    Eigen::VectorXd heights(count), sd(count);
    for (std::size_t k = 0; k < count; ++k) {
      const std::size_t i = kept[k];
      q.push_back(feet[i]);
      heights(static_cast<Eigen::Index>(k)) = bundle.residual_mm[index[i]];
      sd(static_cast<Eigen::Index>(k)) = std::hypot(cells[index[i]].sd_mm, 0.005);
    }
    const FieldChoice choice = choose_field(face, q, heights, sd);
    face.field = make_field(feet, choice.amplitude_mm, choice.length_mm, 60);
    face.coefficients = Eigen::VectorXd::Zero(face.field.size());
  }
}

}  // namespace
}  // namespace fitting

Result<Done<Features>> fit(const FitRecipe& recipe, const Job& job, const MeasuredCloud& cloud, const Location& location) {
  using namespace fitting;
  auto prepared = prepare(recipe, job, cloud, location);
  if (!prepared) return tl::unexpected(prepared.error());
  Setup setup = std::move(*prepared);
  Done<Features> done;
  if (setup.edges.empty()) return done;
  const Pose<frame::Base, frame::Part>& T = location.T_base_part;

  // By the drawing first, far enough from the edges that the part's deviation cannot put a point on the wrong face.
  std::vector<Cell> cells;
  std::vector<char> coarse(setup.edges.size(), 0), far;
  Bundle bundle;
  const auto find_cells = [&](Association how) {
    how.is_far = far, how.far_reach_mm = kFarReach_mm;
    return associate(how, cloud, T, corrections_of(setup), setup.is_fine, coarse, setup.edges, setup.faces, setup.all_edges, setup.all_edges_index);
  };
  for (const double margin : {std::min(1.5, recipe.deviation_max_mm), 0.5, 0.1}) {
    const Association how{setup.band_mm + margin, setup.reach_mm, setup.band_mm + margin, recipe.deviation_max_mm};
    far.clear();
    cells = find_cells(how);
    if (std::vector<char> more = choose_far(setup, cells); !more.empty()) {
      far = std::move(more);
      cells = find_cells(how);
    }
    if (margin == 0.1 && !check_seen(setup, cells, job).empty()) {  // the last resort: what the coarser sensors saw
      coarse = find_coarse_edges(setup, cells);
      cells = find_cells(how);
    }
    if (check_seen(setup, cells, job).empty()) break;
  }
  if (Refusals r = check_seen(setup, cells, job); !r.empty()) return refuse_all(std::move(r));
  // The captures stay as located while the faces get the freedom they need: else a bent face would tear its captures apart.
  const std::vector<CaptureModel> free_captures = setup.captures;
  for (CaptureModel& c : setup.captures) c.is_free = false;
  bundle = solve_bundle({}, cells, T, setup.faces, setup.captures);
  std::vector<Traced> traced = trace_all(setup, job, recipe, false);
  if (Refusals r = check_traced(recipe, setup, traced, job); !r.empty()) return refuse_all(std::move(r));

  // Then by what was found: closer to the edges, with the fields that the residuals ask for.
  double moved_most = 0;
  for (std::size_t e = 0; e < setup.edges.size(); ++e) {
    EdgeModel& edge = setup.edges[e];
    for (std::size_t i = 0; i < edge.nominal.size(); ++i) {
      const auto x = intersect_at(setup.faces[edge.slot_1], setup.faces[edge.slot_2], edge.current[i], edge.tangent[i], rad_from_deg(5));
      if (x) edge.current[i] = *x;
      moved_most = std::max(moved_most, (edge.current[i] - edge.nominal[i]).norm());
    }
  }
  for (const FaceModel& f : setup.faces) must(std::isfinite(f.rms_mm), "fit: rms");
  cells = find_cells({setup.band_mm, setup.reach_mm, setup.band_mm + std::min(moved_most, recipe.deviation_max_mm), 0.5});
  bundle = solve_bundle({}, cells, T, setup.faces, setup.captures);
  choose_fields(setup, cells, bundle, T);
  bundle = solve_bundle({}, cells, T, setup.faces, setup.captures);
  // The location saw the whole part and the robot's error; its corrections are touched only where captures visibly disagree.
  const Disagreement left = worst_disagreement(setup, cloud, location, cells, bundle);
  if (left.distance_mm > 0.05 + 2 * left.noise_mm && left.places_count >= 30) {
    setup.captures = free_captures;
    bundle = solve_bundle({}, cells, T, setup.faces, setup.captures);
    done.notes.push_back({Note::Level::note, "fit.captures_refined",
                          "Two captures put one face " + fixed_number(left.distance_mm, 3) + " mm apart; all captures were adjusted to each other.",
                          cloud.captures[left.capture_a].name + " and " + cloud.captures[left.capture_b].name});
  }
  traced = trace_all(setup, job, recipe, true);
  if (Refusals r = check_traced(recipe, setup, traced, job); !r.empty()) return refuse_all(std::move(r));

  const Solved solved{recipe, job, cloud, location, setup, cells, bundle, traced};
  if (Refusals r = check_captures(solved); !r.empty()) return refuse_all(std::move(r));
  done.artefact = finish(solved);
  if (Refusals r = check_broken(solved, done.artefact); !r.empty()) return refuse_all(std::move(r));
  for (const AdaptedEdge& e : done.artefact.edges) {
    std::size_t extrapolated = 0;
    for (const StationStatus s : e.status) extrapolated += s != StationStatus::measured;
    if (extrapolated == 0) continue;
    done.notes.push_back({Note::Level::note, "fit.extrapolated",
                          fixed_number(100.0 * static_cast<double>(extrapolated) / static_cast<double>(e.status.size()), 1) +
                              " % of the edge lies between seen places and was continued from them.",
                          "edge " + e.id + " of " + e.feature});
  }
  return done;
}

}  // namespace asbuilt
