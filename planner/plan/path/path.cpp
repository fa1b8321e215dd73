// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/path/path.hpp"

#include <algorithm>
#include <cmath>

#include "planner/base/number.hpp"
#include "planner/plan/feed/feed.hpp"
#include "planner/plan/path/chain.hpp"
#include "planner/plan/path/gate.hpp"
#include "planner/plan/path/pass.hpp"
#include "planner/plan/path/posture.hpp"
#include "planner/plan/path/tool_fit.hpp"

namespace asbuilt {

namespace {

constexpr const char* kStage = "path";

std::string edge_place(const AdaptedEdge& e, double s_mm) { return "edge " + e.id + " at " + fixed_number(s_mm, 1) + " mm"; }
std::string percent(double ratio) { return fixed_number(100 * ratio, 1) + " %"; }

/// One feature's work, edge by edge, in the frame of the part.
struct FeatureWork {
  const FeatureSpec* feature = nullptr;
  const Recipe* recipe = nullptr;
  const ToolSpec* tool = nullptr;
  std::vector<int> edges;  // indices into Features::edges
  Vec3 up_wanted = Vec3::UnitZ();
  double contact_ratio = 0.5;
  double burr_thickness_mm = 0.2;
};

EdgeStation station_of(const AdaptedEdge& e, std::size_t i, bool is_reversed) {
  return {e.adapted[i], is_reversed ? Vec3(-e.tangent[i]) : e.tangent[i], e.n_1[i], e.n_2[i]};
}

void check_arrays(const AdaptedEdge& e, const EdgeBurr& b) {
  const std::size_t n = e.s_mm.size();
  must(n >= 2 && e.adapted.size() == n && e.nominal.size() == n && e.tangent.size() == n && e.n_1.size() == n && e.n_2.size() == n &&
           e.covariance.size() == n && e.status.size() == n,
       "the arrays of an adapted edge are not parallel");
  must(b.height_mm.size() == n, "burr and edge are not parallel");
}

/// First and last station that may be cut; nothing (first > last) where the middle of the edge was not measured.
struct Span {
  std::size_t first = 0, last = 0;
  bool is_broken = false;
  double broken_s_mm = 0, broken_mm = 0;
};
Span measured_span(const AdaptedEdge& e, double end_left_max) {
  Span s;
  const std::size_t n = e.s_mm.size();
  s.last = n - 1;
  const auto seen = [&](std::size_t i) { return e.status[i] != StationStatus::nominal; };
  if (!e.is_closed) {
    while (s.first < n && !seen(s.first)) ++s.first;
    while (s.last > s.first && !seen(s.last)) --s.last;
    if (s.first >= n || e.s_mm[s.first] - e.s_mm.front() > end_left_max) {
      s.is_broken = true, s.broken_s_mm = e.s_mm.front();
      s.broken_mm = e.s_mm[std::min(s.first, n - 1)] - e.s_mm.front();
      return s;
    }
    if (e.s_mm.back() - e.s_mm[s.last] > end_left_max) {
      s.is_broken = true, s.broken_s_mm = e.s_mm[s.last], s.broken_mm = e.s_mm.back() - e.s_mm[s.last];
      return s;
    }
  }
  for (std::size_t i = s.first; i <= s.last; ++i)
    if (!seen(i)) {
      s.is_broken = true;
      if (s.broken_mm == 0) s.broken_s_mm = e.s_mm[i];
      s.broken_mm += 0.5 * ((i + 1 < n ? e.s_mm[i + 1] : e.s_mm[i]) - (i > 0 ? e.s_mm[i - 1] : e.s_mm[i]));
    }
  return s;
}

PlacedEdge place_edge(const AdaptedEdge& e, int index, const FeatureWork& w, const Span& span, double offset_mm) {
  PlacedEdge out;
  out.edge = index, out.is_closed = e.is_closed;
  const std::size_t middle = (span.first + span.last) / 2;
  const auto up_at = [&](const EdgeStation& s) {
    return w.recipe->orientation == OrientationMode::tilt ? tilted_up(w.tool->cutter, s, w.up_wanted, w.recipe->cone_rad) : w.up_wanted;
  };
  const EdgeStation mid = station_of(e, middle, false);
  out.is_reversed = !is_climb(mid, place_cutter(w.tool->cutter, mid, up_at(mid), w.recipe->width_mm, 0, w.contact_ratio));
  for (std::size_t k = span.first; k <= span.last; ++k) {
    const std::size_t i = out.is_reversed ? span.last - (k - span.first) : k;
    const EdgeStation s = station_of(e, i, out.is_reversed);
    out.station.push_back(s);
    out.at.push_back(place_cutter(w.tool->cutter, s, up_at(s), w.recipe->width_mm, offset_mm, w.contact_ratio));
    out.s_mm.push_back(e.s_mm[i]);
    out.index.push_back(static_cast<int>(i));
  }
  return out;
}

Refusal burr_refusal(const AdaptedEdge& e, double s_mm, double height, double limit, const std::string& what) {
  return {.code = "path.burr_above_limit",
          .where = edge_place(e, s_mm),
          .message = what,
          .measured = height,
          .limit = limit,
          .unit = "mm",
          .stage = kStage};
}

/// Burr heights against the recipe's limit.
void check_burr(const AdaptedEdge& e, const EdgeBurr& b, const Recipe& r, const Span& span, Refusals& refusals) {
  double worst = 0, worst_s = 0, hidden = 0, hidden_worst = 0, hidden_s = 0;
  for (std::size_t i = span.first; i <= span.last; ++i) {
    if (std::isfinite(b.height_mm[i])) {
      if (b.height_mm[i] > worst) worst = b.height_mm[i], worst_s = e.s_mm[i];
    } else if (std::isfinite(b.height_upper_mm[i]) && b.height_upper_mm[i] > r.burr_max_height_mm) {
      hidden += i > 0 ? e.s_mm[i] - e.s_mm[i - 1] : 0;
      if (b.height_upper_mm[i] > hidden_worst) hidden_worst = b.height_upper_mm[i], hidden_s = e.s_mm[i];
    }
  }
  if (r.burr_max_height_mm > 0 && worst > r.burr_max_height_mm)
    refusals.push_back(burr_refusal(e, worst_s, worst, r.burr_max_height_mm,
                                    "the burr stands " + fixed_number(worst, 2) + " mm proud, the recipe allows " +
                                        fixed_number(r.burr_max_height_mm, 2) + " mm; grind it off first or raise burr.max_height"));
  if (r.burr_max_height_mm > 0 && hidden > 2.0)
    refusals.push_back(burr_refusal(e, hidden_s, hidden_worst, r.burr_max_height_mm,
                                    "over " + fixed_number(hidden, 1) + " mm no burr was seen and one of up to " + fixed_number(hidden_worst, 2) +
                                        " mm cannot be ruled out; scan this edge from the side"));
}

Refusal gate_refusal(const AdaptedEdge& e, const GateResult& g, const Recipe& r, double damage_limit) {
  struct Term {
    double share;
    const char* name;
    const char* fix;
  };
  Term terms[] = {{g.share_edge, "measured edge", "add a detail scan of this edge from the working orientation"},
                  {g.share_scatter, "robot scatter", "widen the tolerance: the robot's own scatter decides"},
                  {g.share_posture, "robot away from its scanning posture", "scan this edge with the tool's axis as it will cut"},
                  {g.share_tool, "tool calibration", "calibrate the tool again with more orientations"},
                  {g.share_interpolation, "path chord", "lower path_tolerance"}};
  std::stable_sort(std::begin(terms), std::end(terms), [](const Term& a, const Term& b) { return a.share > b.share; });
  std::string budget;
  for (const Term& t : terms) budget += std::string(budget.empty() ? "" : ", ") + t.name + " " + percent(t.share);
  const bool is_damage = g.share_ratio >= r.gate_probability_ratio;
  std::string message = is_damage ? "a cut deeper than damage allows has probability " + fixed_number(g.gouge_worst_ratio, 5)
                                  : percent(g.share_ratio) + " of the edge is expected in tolerance, the gate asks for " +
                                        percent(r.gate_probability_ratio);
  message += "; sd across the chamfer " + fixed_number(g.sd_mm, 3) + " mm (" + budget + "); cheapest: ";
  if (g.bias_mm > 0.5 * r.tolerance_mm)
    message += "another tool axis or cutter angle, for the legs differ from the width by " + fixed_number(g.bias_mm, 2) + " mm as planned";
  else
    message += terms[0].fix;
  return {.code = "path.gate",
          .where = edge_place(e, e.s_mm[g.worst_station]),
          .message = message,
          .measured = is_damage ? g.gouge_worst_ratio : g.share_ratio,
          .limit = is_damage ? damage_limit : r.gate_probability_ratio,
          .unit = "ratio",
          .stage = kStage};
}

Refusal fit_refusal(const std::string& where, const std::string& message, double measured, double limit, const std::string& unit) {
  return {.code = "path.tool_does_not_fit", .where = where, .message = message, .measured = measured, .limit = limit, .unit = unit, .stage = kStage};
}

/// Stations where the cutter cannot make the chamfer at all: first fault only.
void check_placements(const AdaptedEdge& e, const PlacedEdge& p, const Recipe& r, Refusals& refusals) {
  for (std::size_t i = 0; i < p.at.size(); ++i) {
    const CutterPlacement& a = p.at[i];
    if (!a.fault.empty()) {
      refusals.push_back(fit_refusal(edge_place(e, p.s_mm[i]), a.fault + "; choose another cutter, contact height or orientation",
                                     a.fault_measured, a.fault_limit, a.fault_unit));
      return;
    }
    const double off = std::max(std::abs(a.leg_1_mm - r.width_mm), std::abs(a.leg_2_mm - r.width_mm));
    if (off > r.tolerance_mm) {
      refusals.push_back(fit_refusal(edge_place(e, p.s_mm[i]),
                                     "with this axis the legs would be " + fixed_number(a.leg_1_mm, 2) + " and " + fixed_number(a.leg_2_mm, 2) +
                                         " mm; use orientation mode tilt or a cutter with another angle",
                                     off, r.tolerance_mm, "mm"));
      return;
    }
  }
}

class Planner {
 public:
  Planner(const PathRecipe& recipe, const Job& job, const Location& location, const Features& features, const Burrs& burrs)
      : recipe_(recipe), job_(job), location_(location), features_(features), burrs_(burrs), posture_(job, location, features) {}

  Result<Done<ToolPath>> run() {
    must(burrs_.edges.size() == features_.edges.size(), "burrs are not parallel to the edges");
    const std::size_t n = features_.edges.size();
    facts_.resize(n), spans_.resize(n);
    out_.artefact.edge_feed_mm_s.resize(n), out_.artefact.edge_passes_count.assign(n, 0);
    out_.artefact.edge_probability_ratio.assign(n, 0), out_.artefact.edge_share_ratio.assign(n, 0);
    std::vector<FeatureWork> works;
    for (const FeatureSpec& f : job_.part.features) {
      FeatureWork w;
      if (prepare(f, w)) works.push_back(w);
    }
    if (works.empty() && refusals_.empty())
      refusals_.push_back({.code = "path.nothing_to_do", .message = "no adapted edge belongs to any feature of the part", .stage = kStage});
    if (!refusals_.empty()) return refuse_all(refusals_);
    part_ = MeshQuery(job_.part.brep.mesh);
    for (FeatureWork& w : works) plan_feature(w);
    if (!refusals_.empty()) return refuse_all(refusals_);
    return out_;
  }

 private:
  const PathRecipe& recipe_;
  const Job& job_;
  const Location& location_;
  const Features& features_;
  const Burrs& burrs_;
  std::vector<EdgeFacts> facts_;
  std::vector<Span> spans_;
  PostureError posture_;
  MeshQuery part_;
  Refusals refusals_;
  Done<ToolPath> out_;

  const AdaptedEdge& edge(int k) const { return features_.edges[static_cast<std::size_t>(k)]; }
  const EdgeBurr& burr(int k) const { return burrs_.edges[static_cast<std::size_t>(k)]; }

  void note(Note::Level level, const char* code, const std::string& text, const std::string& where) {
    out_.notes.push_back({.level = level, .code = code, .text = text, .where = where});
  }

  /// Looks up, checks what needs no path, and passes the gate. False: nothing to plan or refused.
  bool prepare(const FeatureSpec& f, FeatureWork& w) {
    w.feature = &f, w.recipe = job_.recipe(f.recipe);
    const std::size_t before = refusals_.size();
    if (w.recipe == nullptr || w.recipe->process != Process::deburr) {
      refusals_.push_back({.code = "path.process",
                           .where = "feature " + f.id,
                           .message = w.recipe == nullptr ? "the recipe " + f.recipe + " is not among the batch's recipes"
                                                          : "the process of recipe " + f.recipe + " is not deburr; only deburr has a tool path",
                           .stage = kStage});
      return false;
    }
    w.tool = job_.tool(w.recipe->tool);
    if (w.tool == nullptr) {
      refusals_.push_back(fit_refusal("feature " + f.id, "the recipe's tool " + w.recipe->tool + " is not in the cell", 0, 0, ""));
      return false;
    }
    w.up_wanted = -(location_.T_base_part.inverse().direction(w.recipe->axis_base.normalized()));
    w.contact_ratio = recipe_.contact_height_ratio;
    for (int k = 0; k < static_cast<int>(features_.edges.size()); ++k)
      if (edge(k).feature == f.id) w.edges.push_back(k);
    std::vector<const EdgeBurr*> burrs;  // one recipe, one kind of burr
    for (const FeatureSpec& other : job_.part.features)
      for (std::size_t k = 0; other.recipe == f.recipe && k < features_.edges.size(); ++k)
        if (features_.edges[k].feature == other.id) burrs.push_back(&burrs_.edges[k]);
    w.burr_thickness_mm = burr_thickness_mm(burrs);
    for (int k : w.edges) prepare_edge(w, k);
    return refusals_.size() == before && !w.edges.empty();
  }

  void prepare_edge(const FeatureWork& w, int k) {
    const AdaptedEdge& e = edge(k);
    check_arrays(e, burr(k));
    const Recipe& r = *w.recipe;
    if (e.edge >= 0 && e.edge < static_cast<int>(job_.part.brep.edges.size()) &&
        job_.part.brep.edges[static_cast<std::size_t>(e.edge)].kind == EdgeKind::sharp_concave) {
      refusals_.push_back({.code = "path.not_convex",
                           .where = "edge " + e.id,
                           .message = "the edge is an inner one: there is nothing to chamfer; take it out of feature " + e.feature,
                           .stage = kStage});
      return;
    }
    Span& span = spans_[static_cast<std::size_t>(k)];
    span = measured_span(e, recipe_.end_left_max_mm);
    if (span.is_broken) {
      refusals_.push_back({.code = "path.unmeasured",
                           .where = edge_place(e, span.broken_s_mm),
                           .message = "over " + fixed_number(span.broken_mm, 1) +
                                      " mm nothing was measured, and what was not measured is not cut; add a scan that sees both faces here",
                           .measured = span.broken_mm,
                           .limit = recipe_.end_left_max_mm,
                           .unit = "mm",
                           .stage = kStage});
      return;
    }
    check_burr(e, burr(k), r, span, refusals_);
    const PlacedEdge p = place_edge(e, k, w, span, 0);
    const std::size_t before = refusals_.size();
    check_placements(e, p, r, refusals_);
    if (refusals_.size() != before) return;
    // the gate, in the edge's own order
    const std::size_t n = e.s_mm.size();
    std::vector<CutterPlacement> at(n);
    for (std::size_t i = 0; i < n; ++i) {
      const EdgeStation s = station_of(e, i, p.is_reversed);
      at[i] = place_cutter(w.tool->cutter, s,
                           r.orientation == OrientationMode::tilt ? tilted_up(w.tool->cutter, s, w.up_wanted, r.cone_rad) : w.up_wanted,
                           r.width_mm, 0, w.contact_ratio);
    }
    const Mat3 R_part_tool = quat_from_z(-w.up_wanted, Vec3::UnitX()).toRotationMatrix();
    GateTerms terms = gate_terms(job_, *w.tool, R_part_tool, r.path_tolerance_mm);
    terms.posture = posture_of(w, at);
    const GateResult g = judge_edge(e, at, r, terms, recipe_.damage_mm);
    EdgeFacts& facts = facts_[static_cast<std::size_t>(k)];
    facts.probability_ratio = g.probability_ratio;
    facts.burr = burr_bounds(burr(k), r.burr_max_height_mm, w.burr_thickness_mm);
    facts.shift.resize(n);
    for (std::size_t i = 0; i < n; ++i) facts.shift[i] = e.adapted[i] - e.nominal[i];
    out_.artefact.edge_probability_ratio[static_cast<std::size_t>(k)] = g.whole_ratio;
    out_.artefact.edge_share_ratio[static_cast<std::size_t>(k)] = g.share_ratio;
    const bool is_held = g.share_ratio < r.gate_probability_ratio || g.gouge_worst_ratio > recipe_.damage_probability_max_ratio;
    const Override* o = is_held ? override_for(job_, e.id) : nullptr;
    if (is_held && o == nullptr) {
      refusals_.push_back(gate_refusal(e, g, r, recipe_.damage_probability_max_ratio));
    } else if (is_held) {
      note(Note::Level::warning, "path.gate_override",
           "edge " + e.id + " passed by " + o->name + " until " + o->expires + ": " + o->reason + " (expected share " + percent(g.share_ratio) + ")",
           "edge " + e.id);
    } else {
      note(Note::Level::note, "path.gate",
           "edge " + e.id + ": " + percent(g.share_ratio) + " expected in tolerance, sd across the chamfer " + fixed_number(g.sd_mm, 3) + " mm",
           "edge " + e.id);
    }
  }

  /// At a few stations; those between take the nearest one's.
  std::vector<Mat3> posture_of(const FeatureWork& w, const std::vector<CutterPlacement>& at) {
    constexpr std::size_t kLooks = 5;
    std::vector<Mat3> out(at.size());
    bool is_any = false;
    for (std::size_t k = 0; k < kLooks; ++k) {
      const std::size_t begin = k * at.size() / kLooks, end = (k + 1) * at.size() / kLooks;
      if (begin == end) continue;
      const CutterPlacement& a = at[(begin + end) / 2];
      const Mat3 c = posture_.covariance(*w.tool, w.feature->id, a.tip, a.up);
      is_any = is_any || c.trace() > 0;
      for (std::size_t i = begin; i < end; ++i) out[i] = c;
    }
    return is_any ? out : std::vector<Mat3>();
  }

  std::vector<PlacedEdge> place_all(const FeatureWork& w, const std::vector<int>& edges, double offset) const {
    std::vector<PlacedEdge> out;
    for (int k : edges) out.push_back(place_edge(edge(k), k, w, spans_[static_cast<std::size_t>(k)], offset));
    return out;
  }

  PassSettings settings_of(const FeatureWork& w, double outer, double inner) const {
    PassSettings s;
    s.outer_mm = outer, s.inner_mm = inner, s.lead_mm = w.recipe->lead_mm, s.clear_mm = recipe_.clear_mm;
    s.chord_mm = w.recipe->path_tolerance_mm, s.feed_min_mm_s = w.recipe->feed_min_mm_s;
    s.feed_ceiling_mm_s = feed_ceiling_mm_s(*w.recipe, w.tool->cutter), s.removal_max_mm3_s = w.recipe->removal_max_mm3_s;
    return s;
  }

  double reach_of(const FeatureWork& w) const { return w.tool->cutter.diameter_mm + w.recipe->lead_mm; }

  void plan_feature(FeatureWork& w) {
    const Recipe& r = *w.recipe;
    if (feed_ceiling_mm_s(r, w.tool->cutter) < r.feed_min_mm_s) {
      refusals_.push_back({.code = "path.feed_below_min",
                           .where = "recipe " + r.id,
                           .message = "chip load and spindle speed allow less than feed.min; raise the spindle speed or lower feed.min",
                           .measured = feed_ceiling_mm_s(r, w.tool->cutter),
                           .limit = r.feed_min_mm_s,
                           .unit = "mm/s",
                           .stage = kStage});
      return;
    }
    std::vector<Vec3> worked;
    for (const AdaptedEdge& e : features_.edges) worked.insert(worked.end(), e.nominal.begin(), e.nominal.end());
    const ToolFit fit(part_, w.tool->cutter, std::move(worked), r.width_mm, r.tolerance_mm, recipe_.stray_max_mm);
    // finishing: as high on the flank as the surroundings allow
    std::vector<PlacedEdge> placed;
    std::vector<Chain> chains;
    std::vector<BuiltPass> built;
    Refusal last;
    bool is_fitting = false;
    for (double ratio = recipe_.contact_height_ratio; ratio >= recipe_.contact_height_min_ratio - 1e-9; ratio *= 0.75) {
      w.contact_ratio = ratio;
      placed = place_all(w, w.edges, 0);
      bool has_fault = false;
      for (const PlacedEdge& p : placed)
        for (const CutterPlacement& a : p.at) has_fault = has_fault || !a.fault.empty();
      if (has_fault) break;
      is_fitting = finishing(w, fit, placed, chains, built, last);
      if (is_fitting) break;
    }
    if (!is_fitting) {
      refusals_.push_back(last);
      return;
    }
    for (std::size_t c = 0; c < chains.size(); ++c) emit_chain(w, fit, placed, chains[c], built[c]);
  }

  /// Builds every chain at finishing depth. Where the cutter touches the part near an open end, up to end_left_max is given up there.
  bool finishing(const FeatureWork& w, const ToolFit& fit, std::vector<PlacedEdge>& placed, std::vector<Chain>& chains,
                 std::vector<BuiltPass>& built, Refusal& last) {
    for (int round = 0; round < 12; ++round) {
      chains = chain_edges(placed, reach_of(w));
      built.clear();
      bool is_trimmed = false;
      for (const Chain& chain : chains) {
        built.push_back(build_pass(chain, placed, facts_, settings_of(w, 1e9, 0), &fit));
        const BuiltPass& b = built.back();
        if (b.worst.depth_mm <= 0) continue;
        const AdaptedEdge& e = edge(b.worst_edge);
        last = fit_refusal(edge_place(e, b.worst_s_mm),
                           "the cutter would cut " + fixed_number(b.worst.depth_mm + recipe_.stray_max_mm, 2) +
                               " mm into the part beside the chamfer near [" + fixed_number(b.worst.p_part.x(), 1) + ", " +
                               fixed_number(b.worst.p_part.y(), 1) + ", " + fixed_number(b.worst.p_part.z(), 1) +
                               "]; a smaller cutter or another orientation is needed",
                           b.worst.depth_mm + recipe_.stray_max_mm, recipe_.stray_max_mm, "mm");
        if (!trim(placed, b.worst_edge, b.worst_s_mm)) return false;
        is_trimmed = true;
        break;
      }
      if (!is_trimmed) return true;
    }
    return false;
  }

  bool trim(std::vector<PlacedEdge>& placed, int k, double s_mm) {
    const AdaptedEdge& e = edge(k);
    Span& span = spans_[static_cast<std::size_t>(k)];
    if (e.is_closed) return false;
    if (s_mm - e.s_mm.front() <= recipe_.end_left_max_mm) {
      while (span.first < span.last && e.s_mm[span.first] <= s_mm + 1e-9) ++span.first;
      if (e.s_mm[span.first] - e.s_mm.front() > recipe_.end_left_max_mm) return false;
    } else if (e.s_mm.back() - s_mm <= recipe_.end_left_max_mm) {
      while (span.last > span.first && e.s_mm[span.last] >= s_mm - 1e-9) --span.last;
      if (e.s_mm.back() - e.s_mm[span.last] > recipe_.end_left_max_mm) return false;
    } else {
      return false;
    }
    for (PlacedEdge& p : placed) {
      if (p.edge != k) continue;
      PlacedEdge q;
      q.edge = p.edge, q.is_reversed = p.is_reversed, q.is_closed = p.is_closed;
      for (std::size_t i = 0; i < p.at.size(); ++i) {
        const auto index = static_cast<std::size_t>(p.index[i]);
        if (index < span.first || index > span.last) continue;
        q.station.push_back(p.station[i]), q.at.push_back(p.at[i]), q.s_mm.push_back(p.s_mm[i]), q.index.push_back(p.index[i]);
      }
      p = q;
    }
    note(Note::Level::note, "path.end_left", "edge " + e.id + ": a wall beside its end keeps the cutter off the last " +
         fixed_number(std::min(std::abs(s_mm - e.s_mm.front()), std::abs(e.s_mm.back() - s_mm)), 1) + " mm", edge_place(e, s_mm));
    return true;
  }

  /// Passes over one chain: roughing where the burr asks for it, then the finishing pass already built.
  void emit_chain(const FeatureWork& w, const ToolFit& fit, const std::vector<PlacedEdge>& placed, const Chain& chain, const BuiltPass& finish) {
    const Recipe& r = *w.recipe;
    const double area_max = r.removal_max_mm3_s / r.feed_min_mm_s;
    const auto depths_of = [&](const std::vector<const PlacedEdge*>& run) {
      std::vector<BurrBound> burr;
      std::vector<double> chamfer;
      for (const PlacedEdge* p : run)
        for (std::size_t i = 0; i < p->at.size(); ++i) {
          burr.push_back(facts_[static_cast<std::size_t>(p->edge)].burr[static_cast<std::size_t>(p->index[i])]);
          chamfer.push_back(p->at[i].area_mm2);
        }
      return choose_passes(burr, chamfer, area_max, std::max(1, r.burr_max_passes_count));
    };
    // runs of edges that need more than one pass
    std::vector<std::vector<const PlacedEdge*>> runs;
    bool is_in_run = false;
    for (const ChainLink& l : chain.links) {
      const PlacedEdge& p = placed[static_cast<std::size_t>(l.placed)];
      const PassDepths d = depths_of({&p});
      if (d.offsets_mm.empty()) {
        refuse_passes(w, p, d.worst_area_mm2, area_max);
        return;
      }
      if (d.offsets_mm.size() > 1) {
        if (!is_in_run) runs.emplace_back();
        runs.back().push_back(&p);
      }
      is_in_run = d.offsets_mm.size() > 1;
    }
    std::size_t passes = 1;
    std::vector<std::pair<std::vector<int>, PassDepths>> rough;
    for (const auto& run : runs) {
      PassDepths d = depths_of(run);
      std::vector<int> ids;
      for (const PlacedEdge* p : run) ids.push_back(p->edge);
      if (d.offsets_mm.empty()) {  // together they do not fit one set of depths: edge by edge
        for (const PlacedEdge* p : run) rough.push_back({{p->edge}, depths_of({p})});
      } else {
        rough.push_back({ids, d});
      }
    }
    for (const auto& [ids, d] : rough) passes = std::max(passes, d.offsets_mm.size());
    double finish_outer = 1e9;
    for (const auto& [ids, d] : rough) {
      double outer = 1e9;
      for (std::size_t k = 0; k + 1 < d.offsets_mm.size(); ++k) {
        const std::vector<PlacedEdge> at = place_all(w, ids, d.offsets_mm[k]);
        for (const Chain& c : chain_edges(at, reach_of(w)))
          emit(w, build_pass(c, at, facts_, settings_of(w, outer, d.offsets_mm[k]), &fit), static_cast<int>(k) + 1,
               static_cast<int>(d.offsets_mm.size()));
        outer = d.offsets_mm[k];
      }
      finish_outer = std::min(finish_outer, outer);
    }
    if (rough.empty()) {
      emit(w, finish, 1, 1);
    } else {
      // edges that were not roughed carry their whole burr: only those that were may count on less
      PassSettings s = settings_of(w, 1e9, 0);
      std::vector<EdgeFacts> facts = facts_;
      for (const auto& [ids, d] : rough)
        for (int id : ids)
          for (BurrBound& b : facts[static_cast<std::size_t>(id)].burr) {
            const double outer = d.offsets_mm[d.offsets_mm.size() - 2];
            b.area_mm2 = pass_area_mm2(b, outer, 1e-9, 0), b.height_mm = std::min(b.height_mm, outer);
          }
      emit(w, build_pass(chain, placed, facts, s, &fit), static_cast<int>(passes), static_cast<int>(passes));
    }
  }

  void refuse_passes(const FeatureWork& w, const PlacedEdge& p, double area, double area_max) {
    const AdaptedEdge& e = edge(p.edge);
    const auto& bounds = facts_[static_cast<std::size_t>(p.edge)].burr;
    std::size_t worst = 0;
    double chamfer = 0;
    for (std::size_t i = 0; i < bounds.size(); ++i)
      if (bounds[i].area_mm2 > bounds[worst].area_mm2) worst = i;
    for (const CutterPlacement& a : p.at) chamfer = std::max(chamfer, a.area_mm2);
    if (chamfer > area_max) {
      refusals_.push_back({.code = "path.feed_below_min",
                           .where = edge_place(e, p.s_mm.front()),
                           .message = "the chamfer alone would need " + fixed_number(w.recipe->removal_max_mm3_s / chamfer, 2) +
                                      " mm/s, below feed.min; raise removal.max_mm3_s or lower feed.min",
                           .measured = w.recipe->removal_max_mm3_s / chamfer,
                           .limit = w.recipe->feed_min_mm_s,
                           .unit = "mm/s",
                           .stage = kStage});
      return;
    }
    Refusal r = burr_refusal(e, e.s_mm[worst], area, area_max,
                             "the burr is up to " + fixed_number(bounds[worst].height_mm, 2) + " mm high; even in " +
                                 std::to_string(w.recipe->burr_max_passes_count) + " passes one of them would take " + fixed_number(area, 2) +
                                 " mm2 where feed.min and the removal rate allow " + fixed_number(area_max, 2) +
                                 "; raise burr.max_passes or grind it off first");
    r.unit = "mm2";
    refusals_.push_back(r);
  }

  void emit(const FeatureWork& w, const BuiltPass& b, int pass, int passes) {
    if (b.worst.depth_mm > 0) {
      refusals_.push_back(fit_refusal(edge_place(edge(b.worst_edge), b.worst_s_mm), "the cutter would touch the part in a roughing pass; "
                                      "a smaller cutter is needed", b.worst.depth_mm + recipe_.stray_max_mm, recipe_.stray_max_mm, "mm"));
      return;
    }
    CutPass p;
    p.feature = w.feature->id, p.recipe = w.recipe->id, p.tool = w.tool->id, p.edges = b.edges, p.pass = pass, p.passes = passes;
    p.points = b.points, p.retract_part = b.retract, p.approach_mm = w.recipe->approach_mm;
    out_.artefact.passes.push_back(p);
    for (std::size_t k = 0; k < b.edges.size(); ++k) {
      const auto id = static_cast<std::size_t>(b.edges[k]);
      std::vector<double>& f = out_.artefact.edge_feed_mm_s[id];
      if (f.empty()) f = b.feed_mm_s[k];
      else
        for (std::size_t i = 0; i < f.size(); ++i) f[i] = std::min(f[i], b.feed_mm_s[k][i]);
      ++out_.artefact.edge_passes_count[id];
    }
  }
};

}  // namespace

Result<Done<ToolPath>> plan_path(const PathRecipe& recipe, const Job& job, const Location& location, const Features& features,
                                 const Burrs& burrs) {
  return Planner(recipe, job, location, features, burrs).run();
}

}  // namespace asbuilt
