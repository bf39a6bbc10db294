# %% [markdown]
# # Gains by hand
# Move a gain and see what it does to the error, to the least ratio and to the requirement of the hands. Open this file
# in Jupyter as a notebook (`pip install ".[notebook]"`), or run it as a script, which moves one slider.

# %%
from io import StringIO

from IPython.display import SVG, clear_output, display
from ipywidgets import Button, FloatLogSlider, HBox, Output, VBox
from matplotlib.figure import Figure

from vctune import Coupling, Gains, check, draw_ratio, draw_required, judge, read_problem, solve

problem = read_problem("friction-wheel-hands.toml").problem  # in this folder
best = solve(problem).judgement
start = {
    "K_v": best.gains.velocity, "K_p": best.gains.position,
    "b_c": best.coupling.damping, "m_c": best.coupling.mass, "b_0": best.coupling.drag,
}  # fmt: skip
sliders = {name: FloatLogSlider(value, min=-3, max=6, step=0.01, description=name) for name, value in start.items()}
curves, proof, button = Output(), Output(), Button(description="prove it")


# %%
def design() -> tuple[Gains, Coupling]:
    """Return the gains of the sliders."""
    K_v, K_p, b_c, m_c, b_0 = (slider.value for slider in sliders.values())
    return Gains(K_v, K_p), Coupling(b_c, m_c, b_0)


def show(_change: object = None) -> None:
    """Draw the requirement, and print the error and the least ratio of the present gains."""
    figure, image, now = Figure(figsize=(6, 6), layout="constrained"), StringIO(), judge(problem, *design())
    for axes, draw in zip(figure.subplots(2, 1), (draw_required, draw_ratio), strict=True):
        draw(axes, problem, *design()).legend(fontsize="small")
    figure.savefig(image, format="svg")
    with curves:
        clear_output(wait=True)
        print(f"error {now.error:.4g}, least ratio {now.min_ratio:.4g} (at least {problem.stability.safety_factor:g})")
        display(SVG(image.getvalue()))


def prove(_click: object = None) -> None:
    """Check the present gains as `vctune check` does."""
    with proof:
        clear_output(wait=True)
        print(check(problem, *design()).message)


# %%
for slider in sliders.values():
    slider.observe(show, "value")
button.on_click(prove)
show()
sliders["b_c"].value = 0.8 * best.coupling.damping
prove()
display(HBox([VBox([*sliders.values(), button]), VBox([curves, proof])]))
