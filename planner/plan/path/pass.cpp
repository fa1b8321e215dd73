// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/path/pass.hpp"

#include <algorithm>
#include <cmath>

#include "planner/base/result.hpp"

namespace asbuilt {

namespace {

constexpr double kBlendMm = 0.6;      // stations this near to a smooth joint that does not close exactly give way to a straight line
constexpr double kMismatchMm = 0.005;
constexpr double kCornerMeetMm = 0.05; // two lines that pass this near at a corner in the air meet halfway
constexpr double kOverlapMm = 1.5;    // how far a ring runs over its start
constexpr double kFitStepMm = 2.0;    // spacing of the cutter's check against the part; every point near ends and corners
constexpr double kFitEndMm = 6.0;
constexpr double kNeighbourMm = 8.0;  // burrs this near count for the height of a lead's end

struct ChainPoint {
  Vec3 tip, up, m, tau, p, shift;
  int edge = -1, index = -1;  // in Features::edges and the edge's stations; index -1: no station
  double s = 0, leg_1 = 0, leg_2 = 0, probability = 1, chamfer_area = 0, radius = 0;
  BurrBound burr;
  bool keep = false;
  PathPointKind kind = PathPointKind::cut;
};

using Points = std::vector<ChainPoint>;

Points points_of(const PlacedEdge& e, const EdgeFacts& f) {
  Points out(e.at.size());
  for (std::size_t i = 0; i < e.at.size(); ++i) {
    const CutterPlacement& a = e.at[i];
    const auto k = static_cast<std::size_t>(e.index[i]);
    ChainPoint& c = out[i];
    c.tip = a.tip, c.up = a.up, c.m = a.m, c.tau = e.station[i].tau, c.p = e.station[i].p, c.shift = f.shift[k];
    c.edge = e.edge, c.index = e.index[i], c.s = e.s_mm[i], c.leg_1 = a.leg_1_mm, c.leg_2 = a.leg_2_mm;
    c.probability = f.probability_ratio[k], c.chamfer_area = a.area_mm2, c.radius = a.contact_radius_mm, c.burr = f.burr[k];
  }
  return out;
}

void join_smooth(Points& before, Points& after) {
  if (before.size() < 4 || after.size() < 4) return;
  const Vec3 d = after.front().tip - before.back().tip;
  const Vec3 tau = (before.back().tau + after.front().tau).normalized();
  const double along = d.dot(tau), aside = (d - along * tau).norm();
  if (aside < kMismatchMm && along > -kMismatchMm) {
    if (d.norm() < 1e-3) after.erase(after.begin());
    return;
  }
  const Vec3 middle = 0.5 * (after.front().tip + before.back().tip);
  const double reach = kBlendMm + std::max(0.0, -along) / 2;
  while (before.size() > 2 && (middle - before.back().tip).dot(tau) < reach) before.pop_back();
  std::size_t k = 0;
  while (k + 2 < after.size() && (after[k].tip - middle).dot(tau) < reach) ++k;
  after.erase(after.begin(), after.begin() + static_cast<std::ptrdiff_t>(k));
}

ChainPoint corner_point(const ChainPoint& like, const Vec3& tip, PathPointKind kind) {
  ChainPoint c = like;
  c.tip = tip, c.index = -1, c.keep = true, c.kind = kind, c.leg_1 = c.leg_2 = 0, c.chamfer_area = 0;
  return c;
}

std::vector<double> arc_lengths(const Points& points) {
  std::vector<double> s(points.size(), 0);
  for (std::size_t i = 1; i < points.size(); ++i) s[i] = s[i - 1] + (points[i].tip - points[i - 1].tip).norm();
  return s;
}

/// Rolls a smooth ring so that it starts where the burr is lowest, and lets it run over its start. Returns lead-in support behind the start.
void open_ring(Points& ring) {
  if ((ring.front().tip - ring.back().tip).norm() < 1e-3) ring.pop_back();
  const std::size_t n = ring.size();
  std::size_t best = 0;
  double least = 1e300;
  for (std::size_t i = 0; i < n; ++i) {
    double worst = 0, s = 0;
    for (std::size_t k = 0; k < n && s < 8.0; ++k) {
      const std::size_t a = (i + n + k - std::min<std::size_t>(8, n / 2)) % n, b = (a + 1) % n;
      worst = std::max(worst, ring[a].burr.height_mm), s += (ring[b].tip - ring[a].tip).norm();
    }
    if (worst < least - 1e-9) least = worst, best = i;
  }
  std::rotate(ring.begin(), ring.begin() + static_cast<std::ptrdiff_t>(best), ring.end());
  double s = 0;
  Points over{ring.front()};
  for (std::size_t k = 1; k < n && s < kOverlapMm; ++k) {
    s += (ring[k].tip - ring[k - 1].tip).norm();
    over.push_back(ring[k]);
  }
  ring.insert(ring.end(), over.begin(), over.end());
}

/// The tip x mm before the first point (or after the last): on along the ring where it is one, else straight on.
Vec3 run_on(const Points& points, const Points* ring, bool at_start, double x) {
  const ChainPoint& end = at_start ? points.front() : points.back();
  if (ring == nullptr) return end.tip + (at_start ? -x : x) * end.tau;
  // walk the ring backward from the start, or forward from the end of the overlap
  const std::size_t n = ring->size();
  std::size_t i = 0;
  if (!at_start)
    for (std::size_t k = 0; k < n; ++k)
      if (((*ring)[k].tip - end.tip).norm() < 1e-9) i = k;
  Vec3 at = end.tip;
  double left = x;
  for (std::size_t guard = 0; guard < 4 * n; ++guard) {
    const std::size_t j = at_start ? (i + n - 1) % n : (i + 1) % n;
    const Vec3 d = (*ring)[j].tip - at;
    const double l = d.norm();
    if (l >= left && l > 0) return at + d * (left / l);
    left -= l, at = (*ring)[j].tip, i = j;
  }
  return at;
}

Points lead(const Points& points, const Points* ring, bool at_start, double length, double clear, bool is_straight_off) {
  Points out;
  const ChainPoint& end = at_start ? points.front() : points.back();
  for (double t : {0.25, 0.5, 0.75, 1.0}) {
    ChainPoint c = end;
    c.index = -1, c.leg_1 = c.leg_2 = 0, c.chamfer_area = 0;
    c.kind = at_start ? PathPointKind::lead_in : PathPointKind::lead_out;
    c.tip = is_straight_off ? Vec3(end.tip + clear * t * end.m) : Vec3(run_on(points, ring, at_start, length * t) + clear * t * t * end.m);
    out.push_back(c);
  }
  out.back().keep = true;
  if (at_start) std::reverse(out.begin(), out.end());
  return out;
}

}  // namespace

BuiltPass build_pass(const Chain& chain, const std::vector<PlacedEdge>& edges, const std::vector<EdgeFacts>& facts,
                     const PassSettings& settings, const ToolFit* fit) {
  must(!chain.links.empty(), "a chain without edges");
  BuiltPass out;
  // start a ring with corners behind one of them
  std::vector<ChainLink> links = chain.links;
  bool is_ring = chain.is_closed;
  if (is_ring)
    for (std::size_t i = 0; i < links.size(); ++i)
      if (links[i].to_next == Joint::corner) {
        std::rotate(links.begin(), links.begin() + static_cast<std::ptrdiff_t>((i + 1) % links.size()), links.end());
        is_ring = false;
        break;
      }
  std::vector<Points> parts;
  for (const ChainLink& l : links) {
    const PlacedEdge& e = edges[static_cast<std::size_t>(l.placed)];
    parts.push_back(points_of(e, facts[static_cast<std::size_t>(e.edge)]));
    out.edges.push_back(e.edge);
  }
  for (std::size_t i = 0; i + 1 < parts.size(); ++i)
    if (links[i].to_next == Joint::smooth) join_smooth(parts[i], parts[i + 1]);
  if (is_ring && parts.size() > 1) join_smooth(parts.back(), parts.front());
  Points points;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    points.insert(points.end(), parts[i].begin(), parts[i].end());
    if (i + 1 < parts.size() && links[i].to_next == Joint::corner) {
      const Vec3 &a = links[i].corner_out, &b = links[i].corner_in;
      const bool is_one = (a - b).norm() < kCornerMeetMm;
      points.push_back(corner_point(parts[i].back(), is_one ? Vec3(0.5 * (a + b)) : a, PathPointKind::lead_out));
      if (!is_one) points.push_back(corner_point(parts[i + 1].front(), b, PathPointKind::lead_in));
    }
  }
  Points ring;
  if (is_ring) {
    open_ring(points);
    ring = points;
    double over = 0;  // the ring itself, without the overlap
    std::size_t k = ring.size() - 1;
    while (k > 0 && over < kOverlapMm + 1 && (ring[k].tip - ring.front().tip).norm() > 1e-9) over += (ring[k].tip - ring[k - 1].tip).norm(), --k;
    ring.resize(std::max<std::size_t>(k, 1));
  }

  // leads: on along the path, leaving along the chamfer's normal; straight off where a wall stands in the way
  const auto high_near = [&](const ChainPoint& c) {
    double h = 0;
    for (const PlacedEdge& e : edges)
      for (std::size_t i = 0; i < e.station.size(); ++i)
        if ((e.station[i].p - c.p).norm() < kNeighbourMm)
          h = std::max(h, facts[static_cast<std::size_t>(e.edge)].burr[static_cast<std::size_t>(e.index[i])].height_mm);
    return h;
  };
  const auto intrusion_of = [&](const ChainPoint& c) { return fit->check({c.tip, c.up, c.shift}); };
  for (bool at_start : {true, false}) {
    const ChainPoint& end = at_start ? points.front() : points.back();
    const double clear = std::max(0.0, settings.clear_mm + 1.42 * high_near(end) - settings.inner_mm);
    const double length = std::max(settings.lead_mm, clear);
    Points l = lead(points, is_ring ? &ring : nullptr, at_start, length, clear, false);
    if (fit != nullptr && !is_ring) {
      bool is_free = true;
      for (const ChainPoint& c : l) is_free = is_free && intrusion_of(c).depth_mm <= 0;
      if (!is_free) l = lead(points, nullptr, at_start, length, clear, true);
    }
    points.insert(at_start ? points.begin() : points.end(), l.begin(), l.end());
  }

  // the cutter against the part
  if (fit != nullptr) {
    const std::vector<double> s = arc_lengths(points);
    double last = -1e9;
    out.worst.depth_mm = -1e9;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const bool is_near_end = s[i] < kFitEndMm || s.back() - s[i] < kFitEndMm || points[i].keep;
      if (!is_near_end && s[i] - last < kFitStepMm) continue;
      last = s[i];
      const Intrusion here = intrusion_of(points[i]);
      if (here.depth_mm > out.worst.depth_mm) out.worst = here, out.worst_edge = points[i].edge, out.worst_s_mm = points[i].s;
    }
  }

  // feed: the largest cross-section within the cutter's contact decides
  const std::size_t n = points.size();
  std::vector<double> limit(n), position = arc_lengths(points);
  double reach = 0.5;
  for (std::size_t i = 0; i < n; ++i) {
    const ChainPoint& c = points[i];
    const double area = pass_area_mm2(c.burr, settings.outer_mm, settings.inner_mm, c.chamfer_area);
    limit[i] = area > 0 ? std::min(settings.feed_ceiling_mm_s, settings.removal_max_mm3_s / area) : settings.feed_ceiling_mm_s;
    const double extent = std::min(1.42 * c.burr.height_mm, settings.outer_mm) - settings.inner_mm;
    reach = std::max(reach, 0.5 + 0.5 * std::sqrt(std::max(0.0, 2 * c.radius * extent)));
  }
  limit = windowed_min(position, limit, std::min(reach, 3.0));
  std::vector<Vec3> tips(n), axes(n);
  std::vector<char> keep(n);
  for (std::size_t i = 0; i < n; ++i) tips[i] = points[i].tip, axes[i] = points[i].up, keep[i] = points[i].keep;
  const std::vector<FeedBlock> blocks = feed_blocks(tips, axes, limit, keep, 0.8 * settings.chord_mm, settings.feed_min_mm_s);

  out.feed_mm_s.resize(out.edges.size());
  for (std::size_t k = 0; k < out.edges.size(); ++k)
    out.feed_mm_s[k].assign(facts[static_cast<std::size_t>(out.edges[k])].burr.size(), 0.0);
  const auto note_feed = [&](const ChainPoint& c, double feed) {
    if (c.index < 0) return;
    for (std::size_t k = 0; k < out.edges.size(); ++k)
      if (out.edges[k] == c.edge) {
        double& f = out.feed_mm_s[k][static_cast<std::size_t>(c.index)];
        f = f > 0 ? std::min(f, feed) : feed;
      }
  };
  const auto path_point = [](const ChainPoint& c, double feed) {
    PathPoint p;
    p.tip_part = c.tip, p.axis_part = -c.up, p.feed_mm_s = feed, p.kind = c.kind, p.s_mm = c.s, p.leg_1_mm = c.leg_1, p.leg_2_mm = c.leg_2;
    p.probability_ratio = c.probability;
    return p;
  };
  out.points.push_back(path_point(points.front(), blocks.empty() ? settings.feed_min_mm_s : blocks.front().feed_mm_s));
  for (const FeedBlock& b : blocks) {
    out.points.push_back(path_point(points[b.end], b.feed_mm_s));
    for (std::size_t i = b.begin; i <= b.end; ++i) note_feed(points[i], b.feed_mm_s);
  }
  for (auto& f : out.feed_mm_s) {  // stations that gave way to a joint take their neighbour's feed
    for (std::size_t i = 1; i < f.size(); ++i)
      if (f[i] == 0) f[i] = f[i - 1];
    for (std::size_t i = f.size(); i-- > 1;)
      if (f[i - 1] == 0) f[i - 1] = f[i];
  }
  const Vec3 up = (points.front().up + points.back().up).normalized(), away = points.front().m + points.back().m;
  out.retract = up;
  if (std::min(points.front().m.dot(up), points.back().m.dot(up)) < 0.3) out.retract = (up + 0.5 * away).normalized();
  return out;
}

}  // namespace asbuilt
