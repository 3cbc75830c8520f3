"""Small robots as URDF, for tests of forward kinematics."""


def joint(name, kind, parent, child, xyz="0 0 0", rpy="0 0 0", axis="0 0 1", extra=""):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/><limit lower="-9" upper="9"/>{extra}</joint>'
    )


def robot(*joints, links):
    named = "".join(f'<link name="{name}"/>' for name in links)
    return f'<robot name="r">{named}{"".join(joints)}</robot>'


TWO_ARMS = robot(
    *(
        text
        for side, y in (("left", 0.2), ("right", -0.2))
        for text in (
            joint(f"{side}_s0", "revolute", "base", f"{side}_upper", xyz=f"0 {y} 0"),
            joint(f"{side}_s1", "continuous", f"{side}_upper", f"{side}_lower", xyz="0.4 0 0"),
            joint(f"{side}_grip", "fixed", f"{side}_lower", f"{side}_hand", xyz="0.3 0 0"),
        )
    ),
    links=["base", *(f"{side}_{part}" for side in ("left", "right") for part in ("upper", "lower", "hand"))],
)

ODD = robot(
    joint("a", "revolute", "base", "one", "0.1 -0.2 0.3", "0.4 -0.5 0.6", "1 2 3"),
    joint("b", "prismatic", "one", "two", "0.3 0.1 0", "-1 0.2 0.3", "0 -1 1"),
    joint("c", "fixed", "two", "three", "0 0.5 0.1", "0.2 0.2 0.2"),
    joint("d", "continuous", "three", "four", "0.2 0 0", "0 0 1.5", "-1 0 0"),
    links=["base", "one", "two", "three", "four"],
)
