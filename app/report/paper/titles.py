"""The figures by name, in the order of the paper; a number is that of the paper's figure.

Nothing is imported here, so that a shell can complete the names.
"""

TITLES = {
    "1": "Sketch of the bench",
    "2": "Images of the interface",
    "3": "Intensity profiles and apparent contact radius",
    "4": "Principle of the image correlation",
    "4d": "Noise of the displacements against the box",
    "5": "Shear force against displacement",
    "6a": "Displacement fields u_x",
    "6b": "Displacement fields u_y",
    "7": "Displacement in time and onset of sliding",
    "8": "Friction coefficients",
    "9": "Force balance and Young's modulus",
    "10": "Stress fields",
    "11": "Displacement in steady sliding",
    "12": "Displacement during loading",
    "13": "Stress profiles",
    "14": "Stick radius",
    "15": "Local friction law",
    "pressure": "Measured pressure",
    "stiffness": "Stiffness of the interface",
    "law": "Local law over the loads",
    "dissipation": "Work of friction",
    "budget": "Error budget",
}
