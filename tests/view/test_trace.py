from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from massid.result.quantities import Quantity
from massid.result.result import Uncertainty
from massid.score import Truth, score, with_score
from massid.search.proposal import Role
from massid.view.colours import badness
from massid.view.motion import sample_motion
from massid.view.span import plot_end_s, update_times_s
from massid.view.table import format_error, format_kg, table_markdown
from massid.view.trace import Trace
from massid.walk.noise import PRESETS
from tests.view.conftest import Story


def test_the_first_row_is_the_model_file_and_the_last_the_result(online: Story) -> None:
    trace = Trace.of(online.result, online.score)
    assert_allclose(trace.estimate_kg[0], list(online.result.nominal_kg.values()))
    assert_allclose(trace.estimate_kg[-1], list(online.result.estimate_kg.values()))
    assert_allclose(trace.l2_error_kg[0], online.score.l2_error_initial_kg)
    assert_allclose(trace.l2_error_kg[1:], online.score.l2_error_kg)


def test_links_grow_better_as_the_error_falls(online: Story) -> None:
    trace = Trace.of(online.result, online.score)
    assert np.all(trace.relative_error[-1] < 0.01 * trace.relative_error[0])


def test_without_truth_errors_are_distances_to_the_final_estimate(online: Story) -> None:
    trace = Trace.of(online.result, None)
    assert not trace.has_truth
    assert_allclose(trace.error_kg[-1], 0.0, atol=0)
    assert_allclose(trace.reference_kg, online.result.estimate)


def test_without_truth_a_search_that_still_jumps_does_not_look_good(online: Story) -> None:
    last = online.result.windows[-1]
    jumpy = replace(last, newton_step=0.2 * online.result.estimate)
    trace = Trace.of(replace(online.result, windows=(*online.result.windows[:-1], jumpy)), None)
    assert np.all(trace.relative_error >= 0.2 - 1e-12)
    calm = Trace.of(online.result, None)
    assert np.all(calm.relative_error[-1] < 1e-3)


def test_diverged_models_are_not_drawn(online: Story) -> None:
    first = online.result.windows[0]
    mu = first.mu.copy()
    mu[5] = np.inf
    trace = replace(Trace.of(online.result, None), updates=(replace(first, mu=mu),))
    drawn = sum(len(trace.mu(0, role)) for role in Role)
    assert drawn == len(mu) - 1


def test_plots_of_a_short_search_end_soon_after_it(online: Story) -> None:
    trace, motion = Trace.of(online.result, None), sample_motion(online.walk, online.robot)
    last_s = float(trace.update_time_s[-1])
    assert last_s < plot_end_s(trace, motion)
    long_walk = replace(motion, time_s=motion.time_s * 100.0)
    assert last_s < plot_end_s(trace, long_walk) < 2.0 * last_s


def test_plots_of_a_search_through_several_logs_show_all_of_it(online: Story) -> None:
    """The walk that is shown is the first of them."""
    trace, motion = Trace.of(online.result, None), sample_motion(online.walk, online.robot)
    later = replace(trace, update_time_s=trace.update_time_s + 10.0)
    assert plot_end_s(later, motion) == later.update_time_s[-1]


def test_offline_the_passes_share_the_walk_out_in_equal_stretches(offline: Story) -> None:
    trace, motion = Trace.of(offline.result, None), sample_motion(offline.walk, offline.robot)
    end_s = float(motion.time_s[-1])
    times_s = update_times_s(trace, motion)
    assert_allclose(np.diff([*times_s, end_s]), end_s / len(trace.estimate_kg), rtol=1e-12)
    assert (times_s[0], plot_end_s(trace, motion)) == (0.0, end_s)


def test_scores_of_passes_over_more_and_less_of_a_log_are_comparable(offline: Story) -> None:
    first = offline.result.windows[0]
    half = replace(first, mu=0.5 * first.mu)  # half of the output errors, of the same size
    trace = Trace.of(replace(offline.result, windows=(half, first)), None)
    for role in (Role.CENTRE, Role.SAMPLE):
        assert_allclose(trace.mu(0, role), trace.mu(1, role), rtol=1e-12)
    assert_allclose(trace.mu(1, Role.CENTRE), first.chi2, rtol=1e-12)
    silent = Trace.of(replace(offline.result, windows=(replace(first, chi2=np.nan), first)), None)
    assert_allclose(silent.mu(1, Role.SAMPLE), first.mu[silent.rows_of(1, Role.SAMPLE)], rtol=0)
    assert Trace.of(replace(offline.result, mode="online"), None).errors_scored is None


def test_without_truth_no_mass_looks_better_than_its_interval(noisy: Story) -> None:
    trace = Trace.of(noisy.result, None)
    final = noisy.result.estimate
    assert np.all(trace.relative_error >= trace.half_width_kg[-1] / final - 1e-12)
    assert_allclose(trace.relative_error[-1], trace.half_width_kg[-1] / final, rtol=1e-6)
    assert "95 % interval" in trace.colour_meaning
    with_truth = Trace.of(noisy.result, noisy.score)
    assert_allclose(with_truth.relative_error, np.abs(with_truth.error_kg) / with_truth.reference_kg, rtol=0)
    assert with_truth.colour_meaning == "mass error"


def test_without_truth_a_link_that_the_log_does_not_reveal_never_looks_good(online: Story) -> None:
    identifiable = np.arange(len(online.result.space)) != 1
    excitation = replace(online.result.excitation, identifiable=identifiable)
    trace = Trace.of(replace(online.result, excitation=excitation), None)
    assert np.all(badness(trace.relative_error[:, 1]) == 1.0)
    assert np.all(badness(trace.relative_error[-1, identifiable]) < 0.5)


def test_the_final_intervals_are_drawn_however_little_the_estimates_moved(noisy: Story) -> None:
    still = tuple(replace(one, estimate=noisy.result.space.nominal) for one in noisy.result.windows)
    trace = Trace.of(replace(noisy.result, windows=still, estimate=noisy.result.space.nominal), None)
    assert_allclose(trace.drawn_half_width_kg[-1], trace.half_width_kg[-1], rtol=0)
    assert np.all(np.isnan(trace.drawn_half_width_kg[1]))  # twice as wide


def test_the_table_follows_the_estimate(online: Story) -> None:
    trace = Trace.of(online.result, online.score)
    before, after = (table_markdown(trace, update, online.result, online.score) for update in (0, len(trace.updates)))
    link = trace.links[1]
    nominal, estimate = online.result.nominal_kg[link], online.result.estimate_kg[link]
    assert f"| {link} | {nominal:.3f} | **{nominal:.3f}** |" in before
    assert f"| {link} | {nominal:.3f} | **{estimate:.3f}** | {online.score.true_kg[link]:.3f} |" in after
    assert before.startswith("Masses of the model file")
    assert str(online.result.status) in after
    assert "no truth known" in table_markdown(Trace.of(online.result, None), 1, online.result, None)


def test_the_table_says_which_pass_it_shows(noisy: Story) -> None:
    trace = Trace.of(noisy.result, noisy.score)
    first, second, last = (table_markdown(trace, update, noisy.result, noisy.score) for update in range(3))
    assert first.startswith("Model file, before pass 1 of 2")
    assert second.startswith("After pass 1 of 2")
    assert last.startswith("After pass 2 of 2")
    assert "±" not in first
    link, estimate = trace.links[2], trace.estimate_kg[1, 2]
    assert f"**{estimate:.3f}** ±0.196 |" in next(row for row in second.splitlines() if row.startswith(f"| {link} "))


def test_a_link_that_the_log_does_not_reveal_is_marked(online: Story) -> None:
    trace = Trace.of(online.result, online.score)
    hidden = replace(trace, identifiable=np.arange(len(trace.links)) > 0)
    rows = table_markdown(hidden, 1, online.result, online.score).splitlines()
    assert [row.startswith(f"| {trace.links[0]} ") for row in rows if "not identifiable" in row] == [True]


def test_what_else_was_asked_for_stands_below_the_masses_at_the_end(online: Story) -> None:
    payload = Quantity("payload/torso@0,0,0", "kg", 0.0, 2.96, 0.1, True, ("payload/torso@0,0,0",))
    com = replace(payload, name="com/torso/x", unit="m", estimate=0.5, identifiable=False)
    result = replace(online.result, quantities=(payload, com))
    truth = Truth(online.score.true_kg, {payload.name: 3.0})
    scored, trace = score(result, truth), Trace.of(result, online.score)
    before, after = (table_markdown(trace, update, result, scored) for update in (0, len(trace.updates)))
    assert "payload" not in before
    assert "| payload/torso@0,0,0 | 0.0000 | **2.9600** ±0.1960 | 3.0000 | kg |" in after
    assert "| com/torso/x | 0.0000 | not identifiable |  | m |" in after
    entry = with_score(result.document(), scored).quantities
    assert (entry[payload.name].true, entry[payload.name].error) == (3.0, pytest.approx(-0.04))
    assert entry[com.name].true is None


def test_numbers_have_the_digits_they_deserve() -> None:
    assert format_error(-0.1234) == "-0.123"
    assert format_error(3e-7) == "+3e-07"
    assert format_error(0.0) == "+0.000"
    assert format_kg(6.0) == "6.00 kg"
    assert format_kg(2e-5) == "2e-05 kg"


def test_intervals_are_known_where_the_result_knows_them(online: Story) -> None:
    """Hidden links have none; the last row has those of the result, earlier ones those of their windows."""
    n = len(online.result.space)
    noise, identifiable = PRESETS["white"], np.arange(n) != 1
    uncertainty = Uncertainty(noise, np.diag(np.full(n, 0.04)), 1.0, 1.0, 0.3, (), np.zeros(0), np.zeros(0))
    excitation = replace(online.result.excitation, identifiable=identifiable)
    trace = Trace.of(replace(online.result, uncertainty=uncertainty, excitation=excitation), None)
    assert np.all(np.isnan(trace.half_width_kg[:-1]))
    np.testing.assert_array_equal(np.isfinite(trace.half_width_kg[-1]), identifiable)
    np.testing.assert_allclose(trace.half_width_kg[-1, 0], 1.96 * 0.2, rtol=1e-3)
